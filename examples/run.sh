#!/bin/sh
# Builds the program `amps` and remeshes a model to 12,000 vertices: prints the table, writes the mesh and a picture under build/.
#
#   examples/run.sh [MESH]
#
# Without MESH: the Stanford bunny of the Debian package glmark2-data, or a knot where that cannot be had.
set -eu

here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
source=$(dirname -- "$here")
build=$source/build/examples
vertices=12000
bunny=/usr/share/glmark2/models/bunny.obj

case ${1:-} in
  -h | --help) sed -n '2,6s/^# \{0,1\}//p' "$0"; exit 0 ;;
  -*) echo "examples/run.sh: unknown option $1; it takes a mesh file" >&2; exit 2 ;;
esac
mesh=${1:-}
if [ -n "$mesh" ] && [ ! -f "$mesh" ]; then
  echo "examples/run.sh: there is no file $mesh; name a mesh (.obj .off .ply .stl)" >&2
  exit 2
fi

sh "$source/tests/prepare.sh" libeigen3-dev libnanoflann-dev
if [ -z "$mesh" ] && [ ! -f "$bunny" ]; then
  sh "$source/tests/prepare.sh" glmark2-data
fi

cmake -S "$source" -B "$build" -DCMAKE_BUILD_TYPE=Release -DAMPS_BUILD_TESTS=OFF -DAMPS_BUILD_EXAMPLES=ON
cmake --build "$build" --parallel 2 --target amps_cli
amps=$build/examples/amps

if [ -z "$mesh" ]; then
  mesh=$bunny
  if [ ! -f "$mesh" ]; then
    echo "no bunny here (Debian package glmark2-data), taking a knot"
    mesh=$build/knot.obj
    "$amps" make knot "$mesh" --n 20000 --quiet
  fi
fi
name=$(basename -- "$mesh")
out=$source/build/${name%.*}_$vertices
echo
"$amps" remesh "$mesh" "$out.obj" --vertices "$vertices" --json "$out.json"
"$amps" render "$out.obj" "$out.png" --size 1200
echo
echo "wrote $out.obj, $out.json and the picture $out.png"
