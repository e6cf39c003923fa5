#!/bin/sh
# Builds amps and runs its tests. On Debian, installs what they need first; elsewhere, says what is missing.
#
#   tests/run.sh [--sanitize | --races] [BUILD_DIR]
#
# --sanitize builds with ASan, UBSan and all assertions, and leaves out the tests labelled slow, those against CGAL (most of their time
# is CGAL's), and the consumer projects, which build amps anew without them. --races does the same with ThreadSanitizer, for changes to what
# several threads do: slow, so CI does not. BUILD_DIR is build/tests, build/sanitize or build/races by default.
set -eu

here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
source=$(dirname -- "$here")
sanitize=
build=
for argument in "$@"; do
  case $argument in
    --sanitize | --races) sanitize=${argument#--} ;;
    -h | --help) sed -n '2,8s/^# \{0,1\}//p' "$0"; exit 0 ;;
    -*) echo "tests/run.sh: unknown option $argument; it knows --sanitize and --races" >&2; exit 2 ;;
    *) build=$argument ;;
  esac
done

sh "$here/prepare.sh" libeigen3-dev libnanoflann-dev doctest-dev libcgal-dev clang libc++-dev libc++abi-dev ccache
# Apart from the others, since not every Debian-like system has a package of this name; its test is skipped without it.
sh "$here/prepare.sh" chromium python3

set -- -DAMPS_BUILD_TESTS=ON -DAMPS_BUILD_EXAMPLES=ON -DAMPS_INSTALL=ON -DAMPS_TEST_PCH=ON
if command -v ccache >/dev/null 2>&1; then
  set -- "$@" -DCMAKE_CXX_COMPILER_LAUNCHER=ccache
  export CCACHE_SLOPPINESS=pch_defines,time_macros
fi
if [ -n "$sanitize" ]; then
  build=${build:-$source/build/$sanitize}
  sanitizers=address,undefined
  [ "$sanitize" = sanitize ] || sanitizers=thread
  # -O1: the tests are too slow without; NDEBUG is not defined, so every assertion is checked.
  set -- "$@" -DCMAKE_DISABLE_FIND_PACKAGE_CGAL=ON -DCMAKE_BUILD_TYPE=Debug "-DCMAKE_CXX_FLAGS_DEBUG=-O1 -g1" \
    "-DCMAKE_CXX_FLAGS=-fsanitize=$sanitizers -fno-sanitize-recover=all -fno-omit-frame-pointer"
else
  build=${build:-$source/build/tests}
  set -- "$@" -DCMAKE_BUILD_TYPE=Release
fi

cmake -S "$source" -B "$build" "$@"
cmake --build "$build" --parallel 2
if [ -n "$sanitize" ]; then
  ctest --test-dir "$build" --parallel 2 --output-on-failure --label-exclude '^(slow|consumer)$'
else
  ctest --test-dir "$build" --parallel 2 --output-on-failure
fi
