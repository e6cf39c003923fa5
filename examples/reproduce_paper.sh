#!/bin/sh
# Builds what it needs and makes the tables and figures of the paper anew: a page, as HTML and as Markdown, with pictures.
#
#   examples/reproduce_paper.sh [--seeds N] [--data DIRECTORY] [--out DIRECTORY]
#
# Medians over N seeds (default 5). DIRECTORY of models: bunny_100kf_closed.obj and triceratops.off are looked for there (default:
# ../shared/data beside the project, if it is there); nothing is downloaded, and where a model is missing a shape made by amps stands
# in and the page says so. The page goes to build/paper/index.html. Takes under five minutes on two cores, once built.
set -eu

here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
source=$(dirname -- "$here")
build=$source/build/examples
seeds=5
data=$source/../shared/data
out=$source/build/paper

while [ $# -gt 0 ]; do
  case $1 in
    -h | --help) sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 0 ;;
    --seeds | --data | --out)
      [ $# -gt 1 ] || { echo "examples/reproduce_paper.sh: $1 needs a value" >&2; exit 2; }
      case $1 in
        --seeds) seeds=$2 ;;
        --data) data=$2 ;;
        --out) out=$2 ;;
      esac
      [ "$1" != --data ] || [ -d "$data" ] || { echo "examples/reproduce_paper.sh: there is no directory $data" >&2; exit 2; }
      shift 2 ;;
    *) echo "examples/reproduce_paper.sh: unknown option $1 (see --help)" >&2; exit 2 ;;
  esac
done

sh "$source/tests/prepare.sh" libeigen3-dev libnanoflann-dev
cmake -S "$source" -B "$build" -DCMAKE_BUILD_TYPE=Release -DAMPS_BUILD_TESTS=OFF -DAMPS_BUILD_EXAMPLES=ON
cmake --build "$build" --parallel 2 --target amps_reproduce_paper
echo
"$build/examples/reproduce_paper" "$out" "$data" "$seeds"
