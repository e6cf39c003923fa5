// Macros that hosts have defined by the time they include amps: names and values of windows.h, X11, Unreal, Qt, macOS's
// AssertMacros.h, system headers, R, and what programs call their own.
#pragma once

// windows.h, rpcndr.h, wingdi.h
#define min(a, b) (((a) < (b)) ? (a) : (b))
#define max(a, b) (((a) > (b)) ? (a) : (b))
#define near
#define far
#define NEAR near
#define FAR far
#define small char
#define hyper __int64
#define interface struct
#define cdecl _cdecl
#define pascal __stdcall
#define IN
#define OUT
#define OPTIONAL
#define CONST const
#define VOID void
#define TRUE 1
#define FALSE 0
#define ERROR 0
#define NO_ERROR 0L
#define DELETE (0x00010000L)
#define IGNORE 0
#define INFINITE 0xFFFFFFFF
#define STRICT 1
#define THIS void
#define PURE = 0
#define ABSOLUTE 1
#define RELATIVE 2
#define OPAQUE 2
#define TRANSPARENT 1
#define DIFFERENCE 11
#define WINDING 2
#define TEXT(quote) L##quote
#define RGB(r, g, b) ((r) | (g) << 8 | (b) << 16)
#define GetObject GetObjectW
#define GetMessage GetMessageW
#define SendMessage SendMessageW
#define GetCurrentTime() GetTickCount()
#define Yield()
#define rad1 0x0420
#define st1 0x0440

// X.h, Xlib.h
#define Status int
#define Bool int
#define True 1
#define False 0
#define None 0L
#define Success 0
#define Always 2
#define Complex 0
#define Nonconvex 1
#define Convex 2
#define Above 0
#define Below 1
#define Opposite 4
#define Unsorted 0
#define CursorShape 0
#define ParentRelative 1L
#define InputOutput 1
#define CurrentTime 0L
#define KeyPress 2
#define FocusIn 9
#define BadValue 2
#define BadMatch 8

// Unreal, macOS's AssertMacros.h
#define check(expression) \
  {                       \
    if (!(expression)) {  \
    }                     \
  }
#define verify(expression) \
  {                        \
    if (!(expression)) {   \
    }                      \
  }
#define ensure(expression) (!!(expression))
#define require(assertion, label) \
  do {                            \
    if (!(assertion)) goto label; \
  } while (0)
#define checkf(expression, ...)
#define FORCEINLINE inline
#define INDEX_NONE -1
#define nil nullptr
#define YES 1
#define NO 0

// Qt
#define signals public
#define slots
#define emit
#define foreach(variable, container) for (variable : container)
#define forever for (;;)

// complex.h, termios.h, sys/sysmacros.h, newlib's ctype.h
#define I _Complex_I
#define B0 0000000
#define ECHO 0000010
#define major(dev) gnu_dev_major(dev)
#define minor(dev) gnu_dev_minor(dev)
#define makedev(maj, min) gnu_dev_makedev(maj, min)
#define _X 0100
#define _B 0200
#define _U 01
#define _L 02
#define _N 04

// What programs and libraries call their own.
#define PI 3.14159265358979
#define EPSILON 1e-6
#define DEBUG 1
#define LOG(...)
#define INFO 1
#define WARNING 2
#define FATAL 3
#define ASSERT(condition) static_cast<void>(0)
#define CHECK(condition) static_cast<void>(0)
#define REQUIRE(condition) static_cast<void>(0)
#define EXPECT(condition) static_cast<void>(0)
#define SUCCESS 0
#define FAIL 1
#define OK 0
#define UNUSED(x) static_cast<void>(x)
#define BIT(n) (1u << (n))
#define SQR(x) ((x) * (x))
#define VERSION "1.0"
#define T_ 1
#define likely(x) __builtin_expect(!!(x), 1)
#define unlikely(x) __builtin_expect(!!(x), 0)
#define error Rf_error
#define length Rf_length
#define unix 1
#define linux 1
