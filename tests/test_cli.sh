#!/bin/sh
# The command-line program from outside: what it prints, writes and returns. Usage: test_cli.sh PATH_TO_AMPS
set -eu

amps=$1
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
mkdir log empty
failures=0

fail() {
  echo "FAILED: $*"
  failures=$((failures + 1))
}

# run CODE ARGUMENTS...: amps returns CODE; prints an error only with 2 and 4, and with 4 one line.
run() {
  wanted=$1
  shift
  code=0
  "$amps" "$@" >log/out 2>log/err </dev/null || code=$?
  [ "$code" -eq "$wanted" ] || fail "amps $* returned $code, not $wanted: $(head -n 3 log/err)"
  if [ "$wanted" -ne 2 ] && [ "$wanted" -ne 4 ] && [ -s log/err ]; then fail "amps $* complains: $(cat log/err)"; fi
  awk 'length > 80 { exit 1 }' log/out || fail "amps $* prints more than 80 columns: $(awk 'length > 80' log/out)"
  if [ "$wanted" -eq 4 ] && [ "$(wc -l <log/err)" -ne 1 ]; then fail "amps $*: not one line: $(cat log/err)"; fi
}

# bad PATTERN ARGUMENTS...: amps returns 2, says why in one line that matches PATTERN, and leaves no file behind.
bad() {
  pattern=$1
  shift
  before=$(ls -R .)
  run 2 "$@"
  [ "$(wc -l <log/err)" -eq 1 ] || fail "amps $*: not one line on stderr: $(cat log/err)"
  grep -q -e "$pattern" log/err || fail "amps $*: '$(cat log/err)' does not mention '$pattern'"
  [ ! -s log/out ] || fail "amps $* printed to stdout: $(cat log/out)"
  [ "$before" = "$(ls -R .)" ] || fail "amps $* left a file behind"
}

# number KEY FILE: a number in a JSON file written by amps.
number() {
  sed -n "s/^ *\"$1\": \\([-+0-9.e]*\\),*\$/\\1/p" "$2" | head -n 1
}

echo "-- help"
run 0 --help
run 0 --version
for command in sample remesh curves gaps info make render; do
  run 0 "$command" --help
  grep -q "^usage: amps $command " log/out || fail "help of $command has no synopsis"
  # shellcheck disable=SC2013  # options are words
  for option in $(sed -n 's/^  \(--[a-z-]*\).*/\1/p' log/out); do  # what is told is known
    bad "twice\|takes no value" "$command" "$option=" "$option="
  done
done

echo "-- polygons, and counts with an exponent"
printf 'v 0 0 0\nv 2 1 0\nv 0 2 0\nv 1 1 0\nf 1 2 3 4\n' >arrow.obj
run 0 info arrow.obj
grep -q '^area *1$' log/out || fail "the arrow's area: $(cat log/out)"
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 3 0 0\nv 3 1 0\nf 1 2 3 4\nf 2 5 6\n' >bow_tie.obj
run 0 info bow_tie.obj --json info.json
grep -q '^crossing polygons *1$' log/out || fail "a bow tie is not told: $(cat log/out)"
[ "$(number crossing_polygons info.json)" = 1 ] || fail "a bow tie is not in the JSON"
run 0 make sphere exponent.obj --n 1e3
bad "whole number" make sphere x.obj --n 1e
bad "whole number" make sphere x.obj --n 1e99

echo "-- shapes and information"
for shape in sphere torus square knot cube; do
  run 0 make $shape $shape.obj --n 2000
  run 0 info $shape.obj --json info.json
  grep -q '"usable": true' info.json || fail "$shape is not usable"
  n=$(number triangles info.json)
  { [ "$n" -ge 1500 ] && [ "$n" -le 2500 ]; } || fail "$shape has $n triangles for --n 2000"
done
for extension in off ply stl; do
  run 0 make torus torus.$extension --n 2000 --quiet
  [ ! -s log/out ] || fail "--quiet prints"
  run 0 info torus.$extension
done

for file in torus.stl knot.obj cube.obj; do
  run 0 info $file --json info.json
  { [ "$(number self_intersections info.json)" = 0 ] && grep -q '^self-intersections *none' log/out; } || fail "$file crosses itself"
done
printf 'OFF\n6 2 0\n0 0 0\n4 0 0\n0 4 0\n1 1 -1\n1 1 1\n5 5 0\n3 0 1 2\n3 3 4 5\n' >crossing.off
run 0 info crossing.off --json info.json
{ [ "$(number self_intersections info.json)" = 1 ] && grep -q '^self-intersections *1 pair' log/out; } || fail "self-intersections: $(cat log/out)"

echo "-- distance to a reference"
for z in 0 0.5; do
  printf 'OFF\n4 2 0\n0 0 %s\n3 0 %s\n3 4 %s\n0 4 %s\n3 0 1 2\n3 0 2 3\n' $z $z $z $z >flat_$z.off
done
run 0 info flat_0.5.off --reference flat_0.off --json distance.json
grep -q '^Hausdorff distance *0.5   (10 % of its diagonal)' log/out || fail "Hausdorff distance: $(grep Hausdorff log/out)"
grep -q '^RMS distance *0.5   (10 % of its diagonal)' log/out || fail "RMS distance: $(grep RMS log/out)"
awk -v h="$(number hausdorff_percent distance.json)" -v r="$(number rms_percent distance.json)" -v d="$(number reference_diagonal distance.json)" \
  'BEGIN { exit !(h >= 10 - 1e-9 && h < 10.001 && r > 9.9999 && r < 10.0001 && d == 5) }' || fail "distance: $(cat distance.json)"
printf 'OFF\n4 2 0\n0 0 0.5\n6 0 0.5\n6 8 0.5\n0 8 0.5\n3 0 1 2\n3 0 2 3\n' >wide.off
run 0 info flat_0.off --reference wide.off  # from the corner (6, 8, 0.5) to (3, 4, 0); the diagonal is 10
grep -q '^Hausdorff distance *5.024.*(50.2[45] % of its diagonal)' log/out || fail "Hausdorff distance: $(grep Hausdorff log/out)"
run 0 info flat_0.off --json distance.json
! grep -q '"distance"' distance.json || fail "a distance without a reference"
run 0 info sphere.obj --reference sphere.obj --threads 2 --json distance.json
awk -v r="$(number rms distance.json)" 'BEGIN { exit !(r >= 0 && r < 1e-14) }' || fail "a sphere is $(number rms distance.json) from itself"
bad "missing.obj" info sphere.obj --reference missing.obj

echo "-- sampling and gaps"
run 0 sample torus.obj set.xyzr --radius 0.1 --seed 3 --json sample.json
run 0 gaps torus.obj set.xyzr primitives.obj
grep -q '^maximal *yes' log/out || fail "gaps does not say that the set is maximal"
[ ! -e primitives.obj ] || fail "gap primitives of a set without gaps"
awk 'NR % 10 != 0' set.xyzr >holes.xyzr
run 3 gaps torus.obj holes.xyzr primitives.obj --json gaps.json
grep -q '^maximal *no' log/out || fail "gaps does not say that the set is not maximal"
[ "$(number gaps gaps.json)" -gt 0 ] || fail "no gaps counted"
awk -v area="$(number gap_area gaps.json)" 'BEGIN { exit !(area > 0) }' || fail "no area of gaps"
run 0 info primitives.obj
for extension in ply csv; do
  run 0 sample torus.obj set.$extension --radius 0.1 --seed 3
  run 0 gaps torus.obj set.$extension
done

echo "-- remeshing"
run 0 remesh knot.obj out.obj --vertices 1500 --samples out.xyzr --json out.json
n=$(number vertices out.json)
{ [ "$n" -ge 1470 ] && [ "$n" -le 1530 ]; } || fail "$n vertices for --vertices 1500"
awk -v low="$(number min_angle out.json)" -v high="$(number max_angle out.json)" \
  'BEGIN { exit !(low >= 30 - 1e-9 && high <= 120 + 1e-9) }' || fail "angles out of [30, 120]"
awk -v low="$(number min_edge_over_radius out.json)" -v high="$(number max_edge_over_radius out.json)" \
  'BEGIN { exit !(low >= 1 - 1e-9 && high <= 2 + 1e-9) }' || fail "edges out of [r, 2r]"
run 0 gaps knot.obj out.xyzr
run 0 info out.obj

echo "-- optimisation"
run 0 remesh torus.obj acute.obj --vertices 1200 --angle-min 40 --angle-max 95 --convergence course.csv --json acute.json
grep -q '"status": "done"' acute.json || fail "optimisation is not done"
[ "$(head -n 1 course.csv)" = "iteration,bad_triangles,bad_vertices,min_angle,max_angle,samples,energy,seconds" ] ||
  fail "the head of the course"
tail -n 1 course.csv | grep -q '^[0-9]*,0,0,' || fail "the last line of the course has something bad"
run 0 remesh torus.obj plain.obj --vertices 1200 --optimize none --json plain.json
grep -q '"optimization"' plain.json && fail "--optimize none optimises"
run 0 remesh torus.obj fitted.obj --vertices 1200 --fit free --samples on_torus.xyzr --json fitted.json
grep -q '"kind": "free"' fitted.json || fail "no fit is told"
run 0 remesh torus.obj unfitted.obj --vertices 1200 --samples on_torus_too.xyzr --json unfitted.json
grep -q '"fit": {' unfitted.json && fail "fits unasked"
cmp -s on_torus.xyzr on_torus_too.xyzr || fail "a fit moves samples"
cmp -s fitted.obj unfitted.obj && fail "a fit moves nothing"
run 0 remesh torus.obj one.obj --vertices 1200 --optimize angle --iterations 1 --json one.json
[ "$(grep -c '"status": "iteration limit"' one.json)" = 2 ] || fail "--iterations 1 does not stop"
run 0 remesh torus.obj stalled.obj --vertices 60 --angle-min 59 --angle-max 61 --json stalled.json
[ "$(grep -c '"status": "stalled"' stalled.json)" = 2 ] || fail "bounds out of reach are not reported as stalled"
bad "name angle" remesh torus.obj no.obj --vertices 100 --optimize angels
bad "none, normal or free" remesh torus.obj no.obj --vertices 100 --fit tight
bad "goes with" remesh torus.obj no.obj --vertices 100 --optimize valence --angle-min 40
bad "does not go" remesh torus.obj no.obj --vertices 100 --optimize none --convergence course2.csv
bad "written already" remesh torus.obj no.ply --vertices 100 --samples ./no.ply
bad "written already" remesh torus.obj no.obj --vertices 100 --samples no.csv --json no.csv
run 2 remesh torus.obj no.obj --vertices 100 --angle-min 61

echo "-- radii that vary"
run 0 remesh knot.obj lfs.ply --sizing lfs --vertices 3000 --samples lfs.xyzr --json lfs.json
n=$(number vertices lfs.json)
{ [ "$n" -ge 2940 ] && [ "$n" -le 3060 ]; } || fail "$n vertices for --vertices 3000 by lfs"
awk -v low="$(number min_radius lfs.json)" -v high="$(number max_radius lfs.json)" 'BEGIN { exit !(high > 1.2 * low) }' ||
  fail "radii by lfs do not vary"
run 0 gaps knot.obj lfs.xyzr
run 0 sample torus.obj lfs.csv --sizing lfs --rmin 0.05 --rmax 0.1 --gradation 0.1 --json lfs.json
awk -v low="$(number min_radius lfs.json)" -v high="$(number max_radius lfs.json)" 'BEGIN { exit !(low >= 0.05 && high <= 0.1) }' ||
  fail "radii out of --rmin and --rmax"
run 0 sample torus.obj curved.xyzr --error 0.004
run 0 remesh torus.obj within.obj --error 0.5% --json within.json
grep -q '"holds": *true' within.json || fail "--error is not said to hold"
run 0 info within.obj --reference torus.obj --json apart.json
awk -v d="$(number hausdorff_percent apart.json)" 'BEGIN { exit !(d <= 0.5) }' || fail "farther from the input than --error 0.5%"
run 0 gaps torus.obj curved.xyzr
run 0 sample torus.obj curved.xyzr --sizing curvature --vertices 500
awk '/^v / { print 0.05 + 0.05 * ($2 > 0) }' torus.obj >radii.txt
run 0 sample torus.obj file.xyzr --sizing radii.txt
run 0 gaps torus.obj file.xyzr
awk '$4 < 0.05 - 1e-15 || $4 > 0.1 + 1e-15 { exit 1 }' file.xyzr || fail "radii are not those of the file"
{
  printf 'ply\nformat ascii 1.0\nelement vertex %d\nproperty float quality\nend_header\n' "$(wc -l <radii.txt)"
  cat radii.txt
} >radii.ply
run 0 sample torus.obj same.xyzr --sizing radii.ply:quality --gradation 0.2
head -n 5 radii.txt >few.txt

echo "-- disks that know their surface"
# A plate, 1 by 1 by 0.01, from the cube.
run 0 make cube box.obj --n 100
awk '/^v / { $4 = $4 * 0.01 } { print }' box.obj >plate.obj
run 0 remesh plate.obj thin.obj --vertices 2000 --samples thin.xyzr --json thin.json --optimize none
grep -A 12 '"output"' thin.json | grep -q '"euler_characteristic": 2' || fail "the sides of a plate are joined"
run 0 gaps plate.obj thin.xyzr --neighborhood surface
run 0 remesh plate.obj joined.obj --vertices 2000 --neighborhood space --json joined.json --optimize none
grep -A 12 '"output"' joined.json | grep -q '"euler_characteristic": 2' && fail "balls do not join the sides of a plate"
run 0 sample plate.obj thin.csv --radius 0.05 --neighborhood surface
run 0 gaps plate.obj thin.csv --neighborhood surface
bad "surface or space" sample torus.obj no.xyzr --radius 0.1 --neighborhood here

echo "-- curves"
run 0 remesh box.obj edges.obj --vertices 1500 --json edges.json
[ "$(number edges edges.json)" -gt 100 ] || fail "a cube has no curves"
lines=$(grep -c '^l ' edges.obj)
[ "$lines" -gt 100 ] || fail "the edges of a cube are not in the file"
grep -q '"holds": true' edges.json || fail "the topology of a cube is not proved"
run 0 info edges.obj
run 0 remesh box.obj round.obj --vertices 1500 --features none
grep -q '^l ' round.obj && fail "--features none keeps curves"
bad "keep or free" remesh box.obj no.obj --vertices 100 --borders some
bad "does not go with" remesh box.obj no.obj --vertices 100 --features 30 --neighborhood space


echo "-- patches"
[ "$(number forced_triangles edges.json)" -ge 0 ] || fail "no angles beside curves"
awk -v beside="$(grep -A 3 '"beside"' edges.json | number min_angle /dev/stdin)" 'BEGIN { exit !(beside > 10 && beside < 60) }' ||
  fail "angles beside the curves of a cube: $(grep -A 3 '"beside"' edges.json)"
run 0 remesh box.obj edges.obj --vertices 1500
for row in "^curves, corners *12, 8 " "^edges along curves " "^curves off by up to " "^angles beside curves " "^angles away from them "; do
  grep -q "$row" log/out || fail "no row $row of the curves of a cube"
done
# The six groups of a cube, each once, and each in a plane: x, y or z is the same at all its vertices,
# up to rounding.
[ "$(grep -c '^g patch_' edges.obj)" = 6 ] || fail "a cube has $(grep -c '^g patch_' edges.obj) groups"
awk '/^v / { n++; for (k = 1; k <= 3; k++) x[n, k] = $(k + 1) }
     /^g / { group++ }
     /^f / { for (k = 1; k <= 3; k++) for (c = 2; c <= 4; c++) {
               if (!((group, k) in at)) at[group, k] = x[$c, k]
               d = x[$c, k] - at[group, k]
               if (d < -1e-9 || d > 1e-9) apart[group, k] = 1
             } }
     END { for (g = 1; g <= 6; g++) if (apart[g, 1] + apart[g, 2] + apart[g, 3] != 2) exit 1 }' edges.obj ||
  fail "a group of a cube is not one face of it"
run 0 remesh box.obj edges.ply --vertices 1500
head -n 10 edges.ply | grep -q '^property int patch$' || fail "no patches in PLY"
run 0 info edges.ply
run 0 remesh torus.obj smooth.obj --vertices 500
grep -q '^g ' smooth.obj && fail "patches of a torus"

echo "-- curves found"
run 0 curves box.obj box_lines.obj --json curves.json
grep -q '^crease  *12 ' log/out || fail "a cube has not 12 creases: $(cat log/out)"
for want in "curves 12" "corners 8" "patches 6" "closed_loops 0" "dropped_edges 0"; do
  [ "$(number "${want% *}" curves.json)" = "${want#* }" ] || fail "a cube has not $want"
done
[ "$(grep -c '^p ' box_lines.obj)" = 8 ] || fail "the corners of a cube are not in the file"
grep -q '^f ' box_lines.obj && fail "facets among lines"
[ "$(sed -n 's/^l //p' box_lines.obj | tr ' ' '\n' | sort -u | wc -l)" = "$(grep -c '^v ' box_lines.obj)" ] ||
  fail "vertices that are on no curve are written"
run 0 curves box.obj --quiet
[ ! -s log/out ] || fail "--quiet prints"
run 0 curves square.obj square_lines.obj --vertices 300 --json curves.json
grep -A 3 '"border"' curves.json | grep -q '"curves": 4' || fail "a square has not 4 borders"
run 0 curves square.obj none.obj --borders free
grep -q 'none.obj is not written' log/out || fail "curves of a square without borders"
[ ! -e none.obj ] || fail "a file of no curves"
run 0 curves torus.obj none.obj --radius 0.1 --json curves.json
[ "$(number curves curves.json)" = 0 ] || fail "a torus has curves"
run 0 info box.obj --json info.json
grep -q '^curves *12$' log/out || fail "info tells no curves"
grep -A 6 '"curves": {' info.json | grep -q '"corners": 8' || fail "info tells no corners"
bad "not both" curves box.obj --radius 0.1 --vertices 100
bad "obj" curves box.obj no.ply
bad "obj" curves box.obj no.png
bad "nowhere" curves box.obj nowhere/no.obj

echo "-- edges to be kept"
# Of a cube with no creases kept, those of a file.
run 0 remesh box.obj kept.obj --vertices 1500 --features none --keep box_lines.obj --json kept.json
grep -A 20 '"kinds"' kept.json | grep -q '"marked": 12' || fail "the creases of a file are not kept: $(cat kept.json)"
[ "$(number edges_kept kept.json)" = "$(number edges kept.json)" ] || fail "edges along kept curves are lost"
cmp kept.obj edges.obj || fail "marked curves and found ones differ"
run 0 curves kept.obj --features none --keep kept.obj  # a mesh and its own lines
grep -q '^marked  *12 ' log/out || fail "not the curves of the result: $(cat log/out)"
# The same in the file itself, a polyline with negative indices; and two corners in the plane.
run 0 make square flat.obj --n 8
{ cat flat.obj; echo 'l 4 5 -4'; echo 'p 5'; } >marked.obj
run 0 curves marked.obj --borders free --keep marked.obj --json curves.json
grep -A 3 '"marked"' curves.json | grep -q '"curves": 2' || fail "a line with a point on it: $(cat curves.json)"
[ "$(number corners curves.json)" = 3 ] || fail "a line with a point on it has not 3 corners"
# Lines that mark nothing.
{ grep '^v ' flat.obj; echo 'v 0.3 0.3 0'; echo 'l 4 10'; } >off.obj
bad "off.obj: line 11: vertex 10 (0.3, 0.3, 0) is where flat.obj has no vertex" remesh flat.obj no.obj --radius 0.3 --keep off.obj
{ grep '^v ' flat.obj; echo '# far'; echo 'l 1 9'; } >far.obj
bad "far.obj: line 11: from vertex 1 (.*) to vertex 9 (.*) there is no edge of flat.obj" curves flat.obj --keep far.obj
{ cat flat.obj; echo 'v 5 5 5'; } >lonely.obj
{ echo 'v 5 5 5'; echo 'p 1'; } >point.obj
bad "point.obj: line 2: vertex 1 (5, 5, 5) is on no facet of lonely.obj" curves lonely.obj --keep point.obj
bad "nothing.*no line\|no line" curves box.obj --keep box.obj
bad "OBJ files only" curves box.obj --keep edges.ply
bad "missing.obj" curves box.obj --keep missing.obj
bad "does not go with" remesh box.obj no.obj --vertices 100 --keep box_lines.obj --neighborhood space

echo "-- a shape that is lost"
# Balls: where disks know the surface, radii fall until the shape is kept.
run 4 remesh torus.obj lost.obj --radius 3 --neighborhood space --json lost.json --samples lost.xyzr
grep -q '^amps: nothing of the shape is left' log/err || fail "an empty result: $(cat log/err)"
grep -q '"status": "shape changed"' lost.json || fail "the status of an empty result: $(grep status lost.json)"
{ [ -s lost.obj ] && [ -s lost.xyzr ]; } || fail "results of a shape that is lost are not written"
run 4 remesh torus.obj lost.obj --radius 3 --neighborhood space --quiet
[ ! -s log/out ] || fail "--quiet prints"

echo "-- a page"
run 0 remesh box.obj "a & b.obj" --vertices 500 --report page.html
grep -q '^<title>box.obj → a &amp; b.obj</title>$' page.html || fail "the title of a page: $(grep '<title>' page.html)"
grep -q "<code id=\"command\">amps remesh box.obj 'a &amp; b.obj' --vertices 500 --report page.html</code>" page.html ||
  fail "the command is not in the page"
for name in Angles: Valences: 'Edges of the output' Convergence: 'worst coverage' triangulation 'Status: done'; do
  grep -q "$name" page.html || fail "the page does not tell $name"
done
grep -q '{{\|src=\|href=\|url(' page.html && fail "the page is not whole, or refers to others"
run 0 remesh box.obj plain.obj --vertices 500 --report plain.html --optimize none --quiet
grep -q Convergence: plain.html && fail "convergence of nothing"
run 4 remesh torus.obj lost.obj --radius 3 --neighborhood space --report lost.html
grep -q 'Status: nothing of the shape is left' lost.html || fail "the page does not tell that the shape is lost"
bad "written already" remesh torus.obj no.obj --vertices 100 --report no.obj
bad "nowhere" remesh torus.obj no.obj --vertices 100 --report nowhere/no.html

echo "-- in a terminal"
# terminal FILE COMMAND: its output as a terminal of 80 columns gets it, without what the table has.
terminal() { script -qec "stty cols 80; $2" "$1" >log/which 2>&1 </dev/null; }
if script --version 2>log/which | grep -q util-linux && terminal log/typescript true; then
  run 0 make knot large.obj --n 100000
  work="'$amps' remesh large.obj large_out.obj --vertices 60000 --threads 1 --optimize none"
  TERM=xterm terminal log/colours "unset NO_COLOR; $work" || fail "amps in a terminal returns $?"
  TERM=xterm terminal log/plain "NO_COLOR=1 $work" || fail "amps in a terminal returns $?"
  TERM=dumb terminal log/dumb "unset NO_COLOR; $work --quiet" || fail "amps in a terminal returns $?"
  grep -q '\[#*\.*\]  *[0-9]* %  *[0-9.]* %/s  [0-9]*:[0-9][0-9] left' log/plain || fail "no rate or time left: $(tr '\r' '\n' <log/plain | head -n 30)"
  escape=$(printf '\033')
  grep -q "$escape" log/colours || fail "no colours in a terminal"
  grep -q "$escape" log/plain && fail "colours with NO_COLOR"
  grep -q '[#%]' log/dumb && fail "a bar with --quiet"
  tr '\r' '\n' <log/plain | grep -v '^Script' | awk 'length > 80 { exit 1 }' || fail "a bar of more than 80 columns"
  TERM=xterm terminal log/colours "unset NO_COLOR; '$amps' info missing.obj" && fail "a missing file is found"
  grep -q "$escape" log/colours || fail "an error has no colour in a terminal"
  TERM=xterm terminal log/colours "NO_COLOR=1 '$amps' info missing.obj" && fail "a missing file is found"
  grep -q "$escape" log/colours && fail "an error has colours with NO_COLOR"
  script -qec "stty cols 40; NO_COLOR= $work --quiet; '$amps' remesh box.obj narrow.obj --vertices 500" log/narrow >log/which 2>&1 </dev/null
  tr '\r' '\n' <log/narrow | grep '%' | grep -v reached | awk '/^[a-z ]* *[0-9]* %/ && length > 40 { exit 1 }' || fail "a bar wider than its terminal"
else
  echo "skipped: no script(1) of util-linux"
fi

echo "-- the same seed, the same bytes"
run 0 remesh torus.obj a.off --radius 0.1 --seed 5 --threads 1
run 0 remesh torus.obj b.off --radius=0.1 --seed=5 --threads 2
run 0 remesh torus.obj c.off --radius 0.1 --seed 6
cmp a.off b.off || fail "one seed, two results"
! cmp -s a.off c.off || fail "two seeds, one result"

echo "-- pictures"
run 0 render torus.obj torus.png --size 200 --z-up
[ "$(head -c 4 torus.png | tail -c 3)" = PNG ] || fail "torus.png is no PNG"
run 0 render box.obj plain.png --size 200
run 0 render box.obj found.png --size 200 --curves
run 0 render edges.obj lines.png --size 200 --curves
run 0 render edges.obj found_too.png --size 200 --curves --features 40 --threads 2
run 0 render edges.obj none.png --size 200 --curves --features none
run 0 render edges.obj bare.png --size 200
! cmp -s plain.png found.png || fail "curves are not drawn"
cmp lines.png found_too.png || fail "the curves of a result, and those found, are drawn differently"
cmp none.png bare.png || fail "curves are drawn where there are none"
# A line on a small triangle behind a large square: hidden from before, seen from behind.
{
  printf 'v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\nv -0.3 -0.3 0\nv 0.3 -0.3 0\nv 0 0.3 0\n'
  printf 'f 1 2 3 4\nf 5 6 7\nl 5 6\n'
} >behind.obj
for azimuth in 0 180; do
  run 0 render behind.obj without.png --size 200 --azimuth $azimuth --elevation 0
  run 0 render behind.obj with.png --size 200 --azimuth $azimuth --elevation 0 --curves
  code=0
  cmp -s without.png with.png || code=1
  [ $code = $((azimuth / 180)) ] || fail "a line behind a square, seen from azimuth $azimuth"
done
bad "say --curves" render box.obj no.png --features 30
bad "say --curves" render box.obj no.png --radius 0.1
if command -v python3 >log/which 2>&1; then
  python3 - torus.png <<'PYTHON' || fail "torus.png cannot be decoded"
import struct, sys, zlib
data, at, pixels = open(sys.argv[1], "rb").read(), 8, b""
while at < len(data):
    size, kind = struct.unpack(">I4s", data[at:at + 8])
    body = data[at + 8:at + 8 + size]
    assert struct.unpack(">I", data[at + 8 + size:at + 12 + size])[0] == zlib.crc32(kind + body)
    if kind == b"IDAT": pixels += body
    at += 12 + size
assert len(zlib.decompress(pixels)) == 200 * (1 + 3 * 200)
PYTHON
fi

# Sets of remesh say what of the surface they are on: their disks know it, and are not called too near.
run 0 make cube thin.obj --n 12
awk '$1 == "v" { $4 *= 0.05 } { print }' thin.obj >plate2.obj
run 0 remesh plate2.obj plate3.obj --vertices 600 --samples plate3.csv
run 0 gaps plate2.obj plate3.csv
grep -q '^Poisson-disk *yes' log/out || fail "gaps takes a set of remesh for balls"
run 0 gaps plate2.obj plate3.csv --neighborhood space
grep -q '^Poisson-disk *no' log/out || fail "sheets nearer than r are apart for balls"

echo "-- bad usage"
bad "no command"
bad "unknown command" frobnicate
bad "did you mean remesh" remehs
bad "did you mean --radius" remesh torus.obj no.obj --radus 1
bad "unknown option" info torus.obj --frobnicate
bad "needs a value" remesh torus.obj no.obj --radius
bad "wants a number" remesh torus.obj no.obj --radius wide
bad "wants a number" remesh torus.obj no.obj --radius 1x
bad "wants a number" remesh torus.obj no.obj --radius nan
bad "above 0" remesh torus.obj no.obj --radius 0
bad "above 0" remesh torus.obj no.obj --radius -1
bad "whole number" remesh torus.obj no.obj --vertices 12.5
bad "whole number" remesh torus.obj no.obj --vertices 0
bad "whole number" remesh torus.obj no.obj --vertices 99999999999999999999999
bad "whole number" remesh torus.obj no.obj --radius 0.1 --seed -1
bad "either --radius" remesh torus.obj no.obj
bad "either --radius" remesh torus.obj no.obj --radius 0.1 --vertices 10
bad "did you mean lfs" remesh torus.obj no.obj --sizing lsf --vertices 100
bad "say how dense" remesh torus.obj no.obj --sizing lfs
bad "say how dense" remesh torus.obj no.obj --sizing curvature
bad "leave out" remesh torus.obj no.obj --sizing lfs --vertices 100 --rmin 0.1
bad "own radii" remesh torus.obj no.obj --sizing lfs --radius 0.1
bad "goes with" sample torus.obj no.xyzr --sizing lfs --error 0.1
bad "greater than" remesh torus.obj no.obj --sizing lfs --rmin 0.2 --rmax 0.1
bad "radii that vary" remesh torus.obj no.obj --radius 0.1 --gradation 0.1
bad "above 0" remesh torus.obj no.obj --error 0
bad "above 0" remesh torus.obj no.obj --error 0%
bad "wants a number" remesh torus.obj no.obj --error 1%%
bad "wants a number" remesh torus.obj no.obj --error %
bad "few.txt" remesh torus.obj no.obj --sizing few.txt
bad "property nothing" remesh torus.obj no.obj --sizing radii.ply:nothing
bad "twice" remesh torus.obj no.obj --radius 0.1 --radius 0.1
bad "too few" remesh torus.obj --radius 0.1
bad "one argument too many" remesh torus.obj no.obj more.obj --radius 0.1
bad "did you mean knot" make knto no.obj
bad "unknown shape" make teapot no.obj
bad "png" render torus.obj no.jpg

echo "-- outputs that cannot be"
bad "no.xyz" remesh torus.obj no.xyz --radius 0.1
bad "no.obj" sample torus.obj no.obj --radius 0.1
bad "nowhere" remesh torus.obj nowhere/no.obj --radius 0.1
bad "nowhere" remesh torus.obj no.obj --radius 0.1 --json nowhere/no.json
bad "directory" remesh torus.obj empty --radius 0.1
bad "directory" render torus.obj nowhere/no.png

echo "-- inputs that are none"
printf 'OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n' >range.off
printf 'OFF\n3 1 0\n0 0 0\n1 0 0\n' >short.off
printf 'OFF\n3 1 0\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n' >nan.off
printf 'OFF\n3 1 0\n0 0 0\n1 0 inf\n0 1 0\n3 0 1 2\n' >inf.off
printf 'OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n' >flat.off
printf 'OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n' >points.off
printf 'this is not a mesh\n' >text.ply
: >nothing.obj
: >nothing.stl
for file in missing.obj range.off short.off nan.off inf.off flat.off points.off text.ply nothing.obj nothing.stl torus.txt; do
  bad "$file" remesh $file no.obj --radius 0.1
done
bad "empty" info empty
bad "flat.off" info flat.off --reference torus.obj
bad "flat.off" info torus.obj --reference flat.off
bad "missing.xyzr" gaps torus.obj missing.xyzr
printf '0 0 0 -1\n' >negative.xyzr
printf '0 0 zero 1\n' >word.xyzr
: >nothing.xyzr
for file in negative.xyzr word.xyzr nothing.xyzr; do
  bad "$file" gaps torus.obj $file no.obj
done
bad "radius" remesh torus.obj no.obj --radius 1e-9

echo "-- interruption"
# interrupted ARGUMENTS...: amps, which would take far longer, stops after a second, says so in one line and changes no file.
interrupted() {
  before=$(ls -R .; cat stopped.*)
  code=0
  # In the foreground: else the program's group gets the signal too, and a second one ends it at once.
  timeout --foreground --preserve-status -k 20 -s INT 1 "$amps" "$@" >log/out 2>log/err || code=$?
  [ "$code" -eq 130 ] || fail "amps $* interrupted: returned $code"
  [ "$(cat log/err)" = "amps: interrupted, nothing is written" ] || fail "amps $* interrupted: $(cat log/err)"
  [ ! -s log/out ] || fail "amps $* interrupted: printed $(cat log/out)"
  [ "$before" = "$(ls -R .; cat stopped.*)" ] || fail "amps $* interrupted: changed a file"
}
if command -v timeout >log/which 2>&1; then
  run 0 make knot big.obj --n 300000
  echo "as it was" >stopped.obj  # one that is there, others that are not
  interrupted remesh square.obj stopped.obj --radius 0.0005 --samples new.xyzr --json new.json
  interrupted sample big.obj new.xyzr --sizing lfs --rmin 0.0005 --json new.json
  interrupted info big.obj --reference torus.obj --json new.json
  interrupted render torus.obj new.png --size 8192
fi

[ "$failures" -eq 0 ] || { echo "$failures failed"; exit 1; }
echo "all passed"
