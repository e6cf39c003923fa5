#!/bin/sh
# prepare.sh PACKAGE...: gets ready to build. On Debian and its like, installs what is missing of CMake, make, a C++ compiler and the
# packages named. Elsewhere, or without the right to install, says what is missing; fails only if nothing could be built without it
# (CMake fetches the libraries by itself, tests against a library that is not there are skipped).
set -eu

have() { command -v "$1" >/dev/null 2>&1; }
have_compiler() { [ -n "${CXX:-}" ] || have c++ || have g++ || have clang++; }

missing=
have cmake || missing="$missing cmake"
have make || [ -n "${CMAKE_GENERATOR:-}" ] || missing="$missing make"
have_compiler || missing="$missing g++"
if have apt-get && have dpkg-query; then
  for package in "$@"; do
    status=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null) || status=
    [ "$status" = installed ] || missing="$missing $package"
  done
  root=
  [ "$(id -u)" -eq 0 ] || root=sudo
  if [ -n "$missing" ] && [ -n "$root" ] && ! have sudo; then
    echo "missing, and no right to install: as root, apt-get install$missing" >&2
  elif [ -n "$missing" ]; then
    echo "installing:$missing"
    # shellcheck disable=SC2086  # lists of words
    { $root apt-get update -q && $root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends $missing; } \
      >/dev/null || echo "could not install all of:$missing" >&2
  fi
fi

have cmake || { echo "CMake is missing: install version 3.22 or newer" >&2; exit 1; }
have make || [ -n "${CMAKE_GENERATOR:-}" ] || { echo "make is missing: install it, or set CMAKE_GENERATOR=Ninja" >&2; exit 1; }
have_compiler || { echo "a C++17 compiler is missing: install GCC or Clang, or name one in CXX" >&2; exit 1; }
