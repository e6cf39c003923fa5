// host_macros_begin.h (internal): sets macros of the host aside while a header is read; host_macros_end.h puts them back. No
// `#pragma once`: every public header is between the two, its includes as well.
//
// Hosts have macros that are names in amps, Eigen or nanoflann: min, max, near and far are windows.h's, check is Unreal's and
// macOS's, major and minor the C library's, slots Qt's, length and error R's, Success and None X11's. A test includes the
// public headers under these and a hundred more. Behind the headers a macro is back, and a function of its name is called with
// parentheses around: (amps::check)(mesh).
#pragma push_macro("min")
#undef min
#pragma push_macro("max")
#undef max
#pragma push_macro("near")
#undef near
#pragma push_macro("far")
#undef far
#pragma push_macro("check")
#undef check
#pragma push_macro("major")
#undef major
#pragma push_macro("minor")
#undef minor
#pragma push_macro("slots")
#undef slots
#pragma push_macro("length")
#undef length
#pragma push_macro("error")
#undef error
#pragma push_macro("Success")
#undef Success
#pragma push_macro("None")
#undef None
#pragma push_macro("PI")
#undef PI
