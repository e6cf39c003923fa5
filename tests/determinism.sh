#!/bin/sh
# Builds tests/determinism.cpp with many tool chains, runs it, and compares what it prints: results of every part of amps must have the
# same bits. Prints a table; fails if a tool chain differs or cannot build. One that is not installed is named and left out.
#
#   tests/determinism.sh [--few | --all] [--install] [--header amps_single.h] [BUILD_DIR]
#
# --few takes four that differ in all that native ones can differ in: what the tests run. --all adds 32 bits, programs compiled for FMA,
# Windows (MinGW, run by wine) and WebAssembly (Emscripten, run by node). --install installs the tool chains first (Debian). The single header is made if none is given. BUILD_DIR is build/determinism by default.
set -eu

here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
source=$(dirname -- "$here")
all=
few=
install=
header=
build=$source/build/determinism
while [ $# -gt 0 ]; do
  case $1 in
    --all) all=yes ;;
    --few) few=yes ;;
    --install) install=yes ;;
    --header) header=$2; shift ;;
    -h | --help) sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 0 ;;
    -*) echo "tests/determinism.sh: unknown option $1; it knows --few, --all, --install and --header" >&2; exit 2 ;;
    *) build=$1 ;;
  esac
  shift
done
if [ -n "$install" ]; then
  sh "$here/prepare.sh" libeigen3-dev libnanoflann-dev g++ clang libc++-dev libc++abi-dev \
    ${all:+g++-multilib g++-mingw-w64-x86-64-posix wine64 emscripten nodejs}
fi

# name | program that compiles | flags of all | flags of the library | flags of the program | program that runs it
# The first is what the others are compared with. The mixed ones are programs whose own flags allow contraction: inline functions that
# both contain must not be the program's.
configurations() {
  if [ -n "$few" ]; then
    cat <<'END'
gcc -O3|g++|-O3||
gcc -O0, no vectors|g++|-O0 -DEIGEN_DONT_VECTORIZE||
gcc -O3 -march=native|g++|-O3 -march=native||
clang -O2, libc++|clang++|-O2 -stdlib=libc++||
END
    return
  fi
  cat <<'END'
gcc -O3|g++|-O3||
gcc -O0|g++|-O0||
gcc -O3 -march=native|g++|-O3 -march=native||
gcc -O2, no vectors|g++|-O2 -DEIGEN_DONT_VECTORIZE||
clang -O3|clang++|-O3||
clang -O0|clang++|-O0||
clang -O3 -march=native|clang++|-O3 -march=native||
clang -O2, libc++|clang++|-O2 -stdlib=libc++||
END
  [ -z "$all" ] || cat <<'END'
gcc -O3, 32 bits|g++|-O3 -m32 -msse2 -mfpmath=sse||
gcc, program with FMA|g++||-O3|-O1 -fno-inline -march=native -ffp-contract=fast
clang, program with FMA|clang++||-O3|-O0 -march=native -ffp-contract=fast
MinGW, wine|x86_64-w64-mingw32-g++|-O2 -static||
Emscripten, node|em++|-O2 -fexceptions -sALLOW_MEMORY_GROWTH=1||
END
}

# The compiler and how to start what it makes; empty where one of them is missing.
runner_of() {
  case $1 in
    *mingw*) command -v wine || command -v wine64 || ls /usr/lib/wine/wine64 2>/dev/null ;;
    em++) command -v node ;;
    *) echo env ;;
  esac
}

mkdir -p "$build/include"
build=$(CDPATH='' cd -- "$build" && pwd)
export WINEPREFIX="$build/wine" WINEDEBUG=-all
# Debian's Emscripten finds the modules it needs only with Debian's node.
[ -n "${NODE_PATH:-}" ] || [ ! -d /usr/share/nodejs ] || export NODE_PATH=/usr/share/nodejs
if [ -z "$header" ]; then
  cmake -S "$source" -B "$build/header" -DAMPS_BUILD_TESTS=OFF -DAMPS_BUILD_EXAMPLES=OFF >/dev/null
  cmake --build "$build/header" --target amps_single_header >/dev/null
  header=$build/header/amps_single.h
fi
cp "$header" "$build/include/amps_single.h"
# Of the system's headers only these: the others are not those of a cross compiler.
for folder in ${AMPS_INCLUDE:-} /usr/include /usr/local/include; do
  [ ! -f "$folder/nanoflann.hpp" ] || cp "$folder/nanoflann.hpp" "$build/include/"
  [ ! -d "$folder/eigen3/Eigen" ] || eigen=$folder/eigen3
done
: "${eigen:?not found: set AMPS_INCLUDE to a folder with eigen3/Eigen and nanoflann.hpp}"
printf '#define AMPS_IMPLEMENTATION\n#include "amps_single.h"\n' >"$build/library.cpp"
echo 'int main() { return 0; }' >"$build/trial.cpp"
ccache=$(command -v ccache || true)

# one NUMBER NAME COMPILER FLAGS LIBRARY_FLAGS PROGRAM_FLAGS: leaves NUMBER.state, and NUMBER.out if it ran.
one() {
  work=$build/$1
  rm -rf "$work" "$build/$1.out"
  mkdir -p "$work"
  runner=$(runner_of "$3") || true
  command -v "$3" >/dev/null 2>&1 || { echo "left out: no $3" >"$build/$1.state"; return; }
  [ -n "$runner" ] || { echo "left out: nothing to run it" >"$build/$1.state"; return; }
  program=$work/determinism.$(case $3 in *mingw*) echo exe ;; em++) echo js ;; *) echo out ;; esac)
  # shellcheck disable=SC2086  # lists of flags
  if ! "$3" -std=c++17 -pthread $4 $5 $6 "$build/trial.cpp" -o "$program" >"$work/log" 2>&1; then
    echo "left out: cannot build for it" >"$build/$1.state"
    return
  fi
  threads=-pthread
  [ "$3" != em++ ] || threads=
  # shellcheck disable=SC2086
  {
    $ccache "$3" -std=c++17 $threads $4 $5 -I"$build/include" -isystem "$eigen" -c "$build/library.cpp" -o "$work/library.o" &&
      $ccache "$3" -std=c++17 $threads $4 $6 -I"$build/include" -isystem "$eigen" -c "$here/determinism.cpp" -o "$work/program.o" &&
      "$3" -std=c++17 $threads $4 "$work/program.o" "$work/library.o" -o "$program"
  } >"$work/log" 2>&1 || { echo "FAILED to build, see $work/log" >"$build/$1.state"; return; }
  # Emscripten's loader takes file names to node's fetch, where there is one.
  [ "$3" != em++ ] || ! "$runner" --no-experimental-fetch -e '' 2>/dev/null || runner="$runner --no-experimental-fetch"
  # shellcheck disable=SC2086
  if $runner "$program" $((1 + ($1 + 2) % 3)) >"$build/$1.out" 2>"$work/errors"; then
    tr -d '\r' <"$build/$1.out" >"$work/out" && mv "$work/out" "$build/$1.out"
    echo ran >"$build/$1.state"
  else
    echo "FAILED to run, see $build/$1.out" >"$build/$1.state"
  fi
}

configurations >"$build/configurations"
number=0
while IFS='|' read -r name compiler flags library_flags program_flags; do
  number=$((number + 1))
  one $number "$name" "$compiler" "$flags" "$library_flags" "$program_flags" </dev/null &
  [ $((number % 2)) -eq 1 ] || wait
done <"$build/configurations"
wait

code=0
number=0
while IFS='|' read -r name compiler rest; do
  number=$((number + 1))
  state=$(cat "$build/$number.state")
  if [ "$state" = ran ]; then
    different=$(diff "$build/1.out" "$build/$number.out" | sed -n 's/^[<>] \([a-z0-9_]*\).*/\1/p' | sort -u | tr '\n' ' ')
    state="same bits"
    [ -z "$different" ] || state="DIFFERS in $different"
  fi
  case $state in "same bits" | "left out"*) ;; *) code=1 ;; esac
  printf '%-24s %s\n' "$name" "$state"
done <"$build/configurations"
exit $code
