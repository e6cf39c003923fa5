// implementation.cpp: the file with the implementation. Functions of a user's around it must be compiled as if amps were not
// there.
double product_sum_before(double a, double b, double c);
double product_sum_before(double a, double b, double c) { return a * b + c; }

#ifdef AMPS_TEST_DECLARATIONS_FIRST
#include "amps_single.h"
#endif
#define AMPS_IMPLEMENTATION
#include "amps_single.h"
#include "amps_single.h"  // again: nothing is there twice

#if defined(AMPS_OWN_SOURCE) || defined(AMPS_HAS_DOUBLE_CHARCONV)
#error "the single header leaves a macro of its sources behind"
#endif

double product_sum_after(double a, double b, double c);
double product_sum_after(double a, double b, double c) { return a * b + c; }
