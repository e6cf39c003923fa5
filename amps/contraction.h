// contraction.h (internal): no fused multiply-add in the sources of amps. No `#pragma once`: the single header states these
// lines once more where a file took the declarations before it asks for the implementation.
//
// The same bits with every compiler: a multiplication and an addition contracted into one FMA round differently. Vendored users
// do not get our compiler flags, so amps's own sources switch contraction off here, ahead of Eigen; the user's code that
// includes amps is left alone. (Decisions are exact either way, see exact.h: coordinates are at stake.)
// GCC's vectorisers join a pair of a·b + c and a·b − c into one fused instruction whatever fp-contract says, so they are off as
// well, each by its name: "no-tree-vectorize" leaves one on that the command line names.
#if defined(__FAST_MATH__) && defined(AMPS_OWN_SOURCE)
#error "amps decides exactly and cannot be compiled with -ffast-math; compile its sources without it"
#endif
#if defined(AMPS_OWN_SOURCE) && defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(AMPS_OWN_SOURCE) && defined(__GNUC__) && defined(__FP_FAST_FMA)
#pragma GCC optimize("fp-contract=off", "no-tree-loop-vectorize", "no-tree-slp-vectorize")
#elif defined(AMPS_OWN_SOURCE) && defined(_MSC_VER)
#pragma fp_contract(off)
#endif
