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

# run CODE ARGUMENTS...: amps returns CODE; prints an error only with 2 and 4, and with 4 one line. Notes are in log/notes.
run() {
  wanted=$1
  shift
  code=0
  "$amps" "$@" >log/out 2>log/all </dev/null || code=$?
  grep '^amps: note: ' log/all >log/notes || :
  grep -v '^amps: note: ' log/all >log/err || :
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
for command in sample remesh curves gaps fill quality spectrum info make render; do
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

awk '/^v / && !done { $2 = 1e12; done = 1 } { print }' sphere.obj >wild.obj
run 0 info wild.obj --json info.json
grep -q '^far from all others *vertex 0 (0-based) at (1e+12, ' log/out || fail "a wild vertex: $(cat log/out)"
grep -q '^can be remeshed *no' log/out || fail "a mesh with a wild vertex can be remeshed"
[ "$(number wild_vertex info.json)" = 0 ] || fail "a wild vertex is not in the JSON"
bad "wild.obj: mesh: vertex 0 (0-based) at (1e+12, .*) is so far" remesh wild.obj no.obj --vertices 100
bad "wild.obj: mesh: vertex 0 (0-based) at (1e+12, .*) is so far" sample wild.obj no.csv --radius 0.1
bad "wild.obj: mesh: vertex 0 (0-based) at (1e+12, .*) is so far" fill wild.obj none no.csv --radius 0.1

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
grep -q '^ *which is at *-*[0-9]' log/out || fail "gaps does not say where coverage is worst"
[ "$(number gaps gaps.json)" -gt 0 ] || fail "no gaps counted"
awk -v area="$(number gap_area gaps.json)" 'BEGIN { exit !(area > 0) }' || fail "no area of gaps"
run 0 info primitives.obj
for extension in ply csv; do
  run 0 sample torus.obj set.$extension --radius 0.1 --seed 3
  run 0 gaps torus.obj set.$extension
done

echo "-- sets that come from elsewhere, filled"
run 0 fill torus.obj holes.xyzr filled.xyzr --added added.xyzr --json fill.json --threads 1
before=$(wc -l <holes.xyzr)
head -n "$before" filled.xyzr | cmp - holes.xyzr || fail "samples that were there have changed"
tail -n +"$((before + 1))" filled.xyzr | cmp - added.xyzr || fail "--added are not the new ones"
[ "$(number added fill.json)" -eq "$(wc -l <added.xyzr)" ] || fail "added: $(number added fill.json)"
run 0 gaps torus.obj filled.xyzr
run 0 fill torus.obj holes.xyzr filled_2.xyzr --threads 2 --quiet
cmp filled.xyzr filled_2.xyzr || fail "filling depends on the threads"
run 0 fill torus.obj filled.xyzr again.xyzr --added nothing_added.xyzr
cmp filled.xyzr again.xyzr || fail "filling a maximal set changes it"
[ ! -e nothing_added.xyzr ] || fail "a file of no samples"
! grep -q '^off the surface\|^too close' log/out || fail "trouble with a good set: $(cat log/out)"
for extension in ply csv; do  # with facets, and a set of remesh, which knows what of the surface its samples are on
  run 0 fill torus.obj set.$extension facets.$extension
  cmp set.$extension facets.$extension || fail "a maximal $extension set changes"
done
run 0 make cube brick.obj --n 300
run 0 remesh brick.obj box_out.obj --radius 0.2 --samples box_set.csv --quiet
awk 'NR == 1 || NR % 9 != 0' box_set.csv >box_holes.csv
run 0 fill brick.obj box_holes.csv box_filled.csv
head -n "$(wc -l <box_holes.csv)" box_filled.csv | cmp - box_holes.csv || fail "samples of remesh have changed"
run 0 gaps brick.obj box_filled.csv
for nothing in none nothing_at_all.xyzr only_names.csv; do
  : >nothing_at_all.xyzr
  echo x,y,z,radius >only_names.csv
  run 0 fill torus.obj $nothing from_nothing.xyzr --radius 0.1
  run 0 gaps torus.obj from_nothing.xyzr
  bad "say --radius" fill torus.obj $nothing no.xyzr
done
# One sample over the torus and one twice: told, kept, and the surface is covered all the same.
{ cat holes.xyzr; echo "0 0 5 0.1"; head -n 1 holes.xyzr; } >odd.xyzr
run 0 fill torus.obj odd.xyzr odd_filled.xyzr --json odd.json
grep -q '^off the surface *1 samples' log/out || fail "a sample off the surface is hidden: $(cat log/out)"
grep -q '^beside it *1 samples' log/out || fail "a disk beside the surface is hidden: $(cat log/out)"
grep -q '^too close *1 pairs' log/out || fail "samples too close are hidden: $(cat log/out)"
grep -q '^Poisson-disk *no' log/out || fail "a set with a sample twice is no Poisson-disk set: $(cat log/out)"
head -n "$(wc -l <odd.xyzr)" odd_filled.xyzr | cmp - odd.xyzr || fail "odd samples have changed"
run 3 gaps torus.obj odd.xyzr
grep -q '^off the surface *1 samples' log/out || fail "gaps hides a sample off the surface: $(cat log/out)"
grep -q '^too close *1 pairs' log/out || fail "gaps hides samples too close: $(cat log/out)"
bad "use at most" fill torus.obj holes.xyzr no.xyzr --radius 0.2
bad "missing.xyzr" fill torus.obj missing.xyzr no.xyzr
bad "written already" fill torus.obj holes.xyzr no.xyzr --added no.xyzr

echo "-- quality"
run 0 remesh torus.obj q.obj --radius 0.1 --samples q.ply --json q_remesh.json --quiet
run 0 quality q.obj --samples q.ply --json q.json --png q.png
grep -q "^|t'_min|" log/out || fail "no |t'_min|: $(cat log/out)"
awk 'length($0) > 80 { exit 1 }' log/out || fail "a table wider than 80 columns"
for key in mean_min_angle min_q mean_q percent_below_30 percent_valence_5_6_7; do
  [ "$(number $key q.json)" = "$(number $key q_remesh.json)" ] || fail "$key: $(number $key q.json), not $(number $key q_remesh.json)"
done
awk -v e="$(number e_max q.json)" -v t="$(number t_max q.json)" -v low="$(number t_min q.json)" \
  'BEGIN { exit !(e > 0.9 && e <= 1 + 1e-9 && t > 0.5 && t <= 1 + 1e-9 && low >= 1 - 1e-9 && low < 1.2) }' || fail "bounds: $(cat q.json)"
run 0 quality square.obj --json square.json --radius 1  # the grid's right triangles
awk -v q="$(number mean_q square.json)" 'BEGIN { exit !(q > 0.7174 && q < 0.7175) }' || fail "Q of right triangles: $(number mean_q square.json)"
grep -q '"beside_curves"' square.json || fail "triangles at the border of a square are not told apart"
run 0 quality brick.obj --features 30
grep -q '^beside curves' log/out || fail "creases of a box are not told apart: $(cat log/out)"
bad "not both" quality q.obj --samples q.ply --radius 1
bad "samples in" quality torus.obj --samples q.ply
bad "png" quality torus.obj --png no.jpg

echo "-- spectra"
for seed in 1 2 3 4; do
  run 0 sample square.obj square_$seed.xyzr --radius 0.04 --seed $seed --quiet
done
run 0 spectrum square.obj square_?.xyzr --csv power.csv --png power.png --json power.json --threads 1
grep -q '"kind": "periodogram"' power.json || fail "no periodogram of a square"
[ "$(number sets power.json)" -eq 4 ] || fail "not four sets"
awk -v nyquist="$(number effective_nyquist power.json)" 'BEGIN { exit !(nyquist > 0.5 && nyquist < 0.9) }' || fail "effective Nyquist"
awk -F, 'NR == 1 { exit $3 != "radial_mean" }' power.csv || fail "the head of the power"
awk -F, 'NR > 3 && $1 < 7 && $3 > 0.3 { exit 1 }' power.csv || fail "power at low frequencies"
[ "$(head -c 4 power.png | tail -c 3)" = PNG ] || fail "power.png is no PNG"
run 0 spectrum square.obj square_?.xyzr --csv power_2.csv --png power_2.png --threads 2 --quiet
[ ! -s log/out ] || fail "--quiet prints"
cmp power.csv power_2.csv || fail "the power depends on the threads"
cmp power.png power_2.png || fail "the picture of the power depends on the threads"
run 0 spectrum square.obj square_?.xyzr --plot plot.png --quiet
[ "$(head -c 4 plot.png | tail -c 3)" = PNG ] || fail "plot.png is no PNG"
run 0 spectrum torus.obj set.xyzr --plot plot_2.png --quiet
! cmp -s plot.png plot_2.png || fail "two spectra, one plot"
run 0 spectrum square.obj square_1.xyzr --border periodic --max-frequency 20 --csv periodic.csv
[ "$(wc -l <periodic.csv)" -eq 21 ] || fail "not 20 rings"
run 0 spectrum torus.obj set.xyzr --csv differences.csv --png differences.png --json differences.json
grep -q '"kind": "differences"' differences.json || fail "no differences on a torus"
awk -v least="$(number min_distance differences.json)" 'BEGIN { exit !(least >= 1 - 1e-9 && least < 1.2) }' || fail "least distance"
awk -F, 'NR > 1 && $1 < 0.97 && $2 != 0 { exit 1 }' differences.csv || fail "differences below r"
run 0 spectrum square.obj square_1.xyzr --differences --range 3 --json differences.json
awk -v range="$(number range differences.json)" 'BEGIN { exit range != 3 }' || fail "--range 3"
bad "too few" spectrum square.obj
bad "periodograms" spectrum torus.obj set.xyzr --border window
bad "periodograms" spectrum square.obj square_1.xyzr --differences --max-frequency 20
bad "say --differences" spectrum square.obj square_1.xyzr --range 3
bad "window or periodic" spectrum square.obj square_1.xyzr --border round
bad "missing.xyzr" spectrum square.obj square_1.xyzr missing.xyzr
bad "png" spectrum square.obj square_1.xyzr --png no.jpg
bad "png" spectrum square.obj square_1.xyzr --plot no.jpg
bad "written already" spectrum square.obj square_1.xyzr --png no.png --plot no.png
bad "nowhere" spectrum square.obj square_1.xyzr --csv nowhere/no.csv

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

echo "-- an exact number"
run 0 remesh knot.obj exact.obj --vertices 1500 --exact --samples exact.xyzr --json exact.json
[ "$(number vertices exact.json)" = 1500 ] || fail "$(number vertices exact.json) vertices for --vertices 1500 --exact"
[ "$(grep -c '^v ' exact.obj)" = 1500 ] || fail "another number of vertices in the file"
grep -q '"maximal": true' exact.json || fail "an exact number takes maximality"
grep -q '^exact number  *met' log/out || fail "the table does not tell of the exact number"
awk -v low="$(number min_angle exact.json)" -v high="$(number max_angle exact.json)" \
  'BEGIN { exit !(low >= 35 - 1e-6 && high <= 105 + 1e-6) }' || fail "an exact number takes angles"
run 0 gaps knot.obj exact.xyzr
run 0 sample torus.obj exact.csv --vertices 77 --exact --json exact.json
[ "$(number samples exact.json)" = 77 ] || fail "$(number samples exact.json) samples for --vertices 77 --exact"
run 0 gaps torus.obj exact.csv
bad "exact goes with --vertices" remesh torus.obj no.obj --radius 0.1 --exact
bad "exact goes with --vertices" sample torus.obj no.csv --sizing lfs --rmin 0.1 --exact
run 0 make cube cube12.obj --n 12
awk '/^v / { $4 = $4 * 0.01 } { print }' cube12.obj >sheet.obj
run 4 remesh sheet.obj missed.obj --vertices 60 --exact --json missed.json
grep -q "for exactly 60 asked for" log/err || fail "no word of the number that was missed"
grep -q '"status": "count missed"' missed.json || fail "a missed number is called $(grep status missed.json)"
[ -s missed.obj ] || fail "nothing is written where the number is missed"

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
[ "$(grep -c '"status": "stalled"' stalled.json)" -ge 1 ] || fail "bounds out of reach are not reported as stalled"
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
run 4 remesh plate.obj joined.obj --vertices 2000 --neighborhood space --json joined.json --optimize none
grep -q "^amps: note: --neighborhood space keeps no curves" log/notes || fail "no note about curves"
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

echo "-- what the table tells"
awk '{ print } /^f / && n++ < 5 { print "f", $3, $4, $2 }' torus.obj >twice.obj
run 0 remesh twice.obj once.obj --vertices 500 --json once.json
grep -q '^triangles left out *5 ' log/out || fail "facets that are there twice: $(cat log/out)"
[ "$(number left_out_of_input once.json)" = 5 ] || fail "facets that are there twice are not in the JSON"
! grep -q 'changed$\|not kept' log/out || fail "a torus is changed: $(cat log/out)"
run 0 make square equal.obj --n 200
run 0 remesh equal.obj equal_out.obj --vertices 200
grep -q '^angles .*(input: 45.00 to 90.00)   worse$' log/out || fail "worse angles are not marked: $(grep ^angles log/out)"
grep -q '^mean smallest angle .*(input: 45.00)$' log/out || fail "better angles are marked: $(grep ^mean log/out)"
run 4 remesh torus.obj fused.obj --radius 0.7 --neighborhood space --optimize none
grep -q '^Euler characteristic *0 .*changed$' log/out || fail "another topology is not marked: $(grep ^Euler log/out)"
grep -q '^non-manifold edges *0 *[1-9][0-9]*   worse$' log/out || fail "non-manifold edges are not marked"
# A pyramid too small for the radius.
{
  printf 'v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.48 0.48 0\nv 0.52 0.48 0\nv 0.52 0.52 0\nv 0.48 0.52 0\nv 0.5 0.5 0.04\n'
  printf 'f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\nf 5 6 9\nf 6 7 9\nf 7 8 9\nf 8 5 9\n'
} >pyramid.obj
run 0 remesh pyramid.obj pyramid_out.obj --radius 0.2 --optimize none
grep -q '^creases not kept *8 edges *too small for r$' log/out || fail "creases that are dropped: $(cat log/out)"
run 0 remesh pyramid.obj pyramid_out.obj --radius 0.01 --optimize none
! grep -q '^creases not kept' log/out || fail "creases are dropped: $(cat log/out)"

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
for mark in "l 1 99" "l 1 0" "l 2 -10" "p 99" "l 5 5" "l 1 2 2"; do
  { cat flat.obj; echo "$mark"; } >wrong.obj
  bad "wrong.obj: line $(wc -l <wrong.obj): .*\(out of range\|to itself\)" curves wrong.obj --keep wrong.obj
  bad "wrong.obj: line $(wc -l <wrong.obj): .*\(out of range\|to itself\)" remesh flat.obj no.obj --radius 0.3 --keep wrong.obj
done
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
{ [ ! -s log/out ] && [ ! -s log/notes ]; } || fail "--quiet prints"

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
bad "overwrite-input" remesh torus.obj no.obj --vertices 100 --report torus.obj
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
  # Rate and time left come after a second of work, which this may not take: test_terminal.cpp has them.
  grep -q '\[#*\.*\]  *[0-9]* %' log/plain || fail "no bar in a terminal: $(tr '\r' '\n' <log/plain | head -n 30)"
  escape=$(printf '\033')
  grep -q "$escape" log/colours || fail "no colours in a terminal"
  grep -q "$escape" log/plain && fail "colours with NO_COLOR"
  grep -q '[#%]' log/dumb && fail "a bar with --quiet"
  tr '\r' '\n' <log/plain | grep -v '^Script' | awk 'length > 80 { exit 1 }' || fail "a bar of more than 80 columns"
  TERM=xterm terminal log/colours "unset NO_COLOR; '$amps' info missing.obj" && fail "a missing file is found"
  grep -q "$escape" log/colours || fail "an error has no colour in a terminal"
  TERM=xterm terminal log/colours "NO_COLOR=1 '$amps' info missing.obj" && fail "a missing file is found"
  grep -q "$escape" log/colours && fail "an error has colours with NO_COLOR"
  TERM=xterm terminal log/plain "NO_COLOR=1 '$amps' remesh large.obj large_out.obj --radius 0.1 --neighborhood space" || [ $? -eq 4 ] || fail "amps in a terminal returns $?"
  tr '\r' '\n' <log/plain | grep -q '^amps: note: --neighborhood space' || fail "a note is not clear of the bar: $(tr '\r' '\n' <log/plain | head -n 20)"
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
for look in valence angles radius; do
  run 0 render torus.obj look_$look.png --size 120 --look $look --legend
  ! cmp -s look_$look.png torus.png || fail "--look $look is not seen"
done
for look in cells gaps disks radius; do
  run 0 render torus.obj set_$look.png --size 120 --look $look --samples set.xyzr --view iso --legend --threads 1
  run 0 render torus.obj set_2.png --size 120 --look $look --samples set.xyzr --view iso --legend --threads 2
  cmp set_$look.png set_2.png || fail "--look $look depends on the threads"
done
# Of a maximal set nothing is red; of one with holes something is, and so are added samples.
run 0 render torus.obj full.png --size 120 --look gaps --samples set.xyzr --no-dots
run 0 render torus.obj holes.png --size 120 --look gaps --samples holes.xyzr --no-dots
run 0 render torus.obj added.png --size 120 --look gaps --samples set.xyzr --no-dots --added holes.xyzr
if command -v python3 >log/which 2>&1; then
  python3 - <<'PYTHON' || fail "gaps are red, and nothing else is"
import zlib
def red(name):
    data = open(name, "rb").read()
    at = data.index(b"IDAT")
    raw = zlib.decompress(data[at + 4:at + 4 + int.from_bytes(data[at - 4:at], "big")])
    size = int.from_bytes(data[16:20], "big")
    above, count = bytearray(3 * size), 0
    for y in range(size):
        kind, row = raw[y * (3 * size + 1)], bytearray(raw[y * (3 * size + 1) + 1:(y + 1) * (3 * size + 1)])
        for i in range(3 * size):
            a, b, c = (row[i - 3] if i > 2 else 0), above[i], (above[i - 3] if i > 2 else 0)
            pa, pb, pc = abs(b - c), abs(a - c), abs(a + b - 2 * c)
            row[i] = (row[i] + (0, a, b, (a + b) // 2, a if pa <= pb and pa <= pc else b if pb <= pc else c)[kind]) & 255
        count += sum(row[i] > 2 * row[i + 1] and row[i] > 60 for i in range(0, 3 * size, 3))
        above = row
    return count
assert red("full.png") == 0, red("full.png")
assert red("holes.png") > 20, red("holes.png")
assert red("added.png") > 20, red("added.png")
PYTHON
fi
for view in front back left right top bottom; do
  run 0 render box.obj view_$view.png --size 60 --view $view --no-edges
done
run 0 render box.obj angles.png --size 60 --azimuth 180 --elevation 0 --no-edges
cmp view_back.png angles.png || fail "--view back is not that of its angles"
run 0 render torus.obj near.png --size 120 --zoom 3
bad "valence" render torus.obj no.png --look valnce
bad "samples" render torus.obj no.png --look gaps
bad "front" render torus.obj no.png --view below
bad "legend" render torus.obj no.png --legend
bad "missing.xyzr" render torus.obj no.png --look gaps --samples missing.xyzr
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

bad "may not be\|not a directory\|directory" remesh torus.obj torus.obj/no.obj --radius 0.1
ln -s nothing.off dangling.off
bad "link to nothing" make cube dangling.off
rm dangling.off
echo "as it was" >locked.json
chmod 444 locked.json
bad "read-only" info torus.obj --json locked.json
chmod 644 locked.json

echo "-- outputs that would take each other's place, or that of an input"
# same_name ARGUMENTS...: refused, and no file is changed.
same_name() {
  sum=$(cat ./*.* | cksum)
  bad "$@"
  [ "$sum" = "$(cat ./*.* | cksum)" ] || fail "amps $* changed a file"
}
run 0 make torus in.ply --n 500
cp in.ply old.ply
ln -s old.ply link.ply
ln old.ply hard.ply
run 0 sample in.ply in.xyzr --radius 0.3
mkdir sub
for other in new.ply ./new.ply sub/../new.ply "$dir/new.ply" sub/../sub/.././new.ply; do
  same_name "OUT\|written already (OUT)" remesh in.ply new.ply --radius 0.3 --samples "$other"
done
for other in link.ply hard.ply ./sub/../old.ply; do
  same_name "written already (OUT)" remesh in.ply old.ply --radius 0.3 --samples "$other"
  same_name "written already (OUT)" remesh in.ply "$other" --radius 0.3 --samples old.ply
done
same_name "written already (--samples)" remesh in.ply new.ply --radius 0.3 --samples new.csv --convergence new.csv
same_name "written already (--samples)" remesh in.ply new.ply --radius 0.3 --samples new.csv --json new.csv
same_name "written already (--convergence)" remesh in.ply new.ply --radius 0.3 --convergence new.csv --json new.csv
same_name "written already" sample in.ply new.csv --radius 0.3 --json new.csv
same_name "written already" curves in.ply new.obj --json new.obj
same_name "written already" gaps in.ply in.xyzr new.obj --json new.obj
same_name "written already (OUT)" fill in.ply in.xyzr new.csv --added sub/../new.csv
same_name "written already (OUT)" fill in.ply in.xyzr new.csv --json new.csv
same_name "written already (--added)" fill in.ply in.xyzr new.xyzr --added new.csv --json new.csv
same_name "written already (--png)" quality in.ply --png new.png --json ./new.png
same_name "written already (--csv)" spectrum in.ply in.xyzr --csv new.png --png new.png
same_name "written already (--csv)" spectrum in.ply in.xyzr --csv new.csv --json new.csv
same_name "written already (--png)" spectrum in.ply in.xyzr --png new.png --plot new.png
same_name "written already (--plot)" spectrum in.ply in.xyzr --plot new.png --json new.png
ln -s in.ply to_input.ply
ln in.ply other_name.ply
for same in in.ply ./in.ply to_input.ply other_name.ply; do
  same_name "which is read (IN)" remesh in.ply $same --radius 0.3
  same_name "which is read (IN)" remesh in.ply new.ply --radius 0.3 --samples $same
  same_name "which is read (IN)" remesh in.ply new.ply --radius 0.3 --json $same
  same_name "which is read (IN)" remesh in.ply new.ply --radius 0.3 --convergence $same
  same_name "which is read (IN)" sample in.ply $same --radius 0.3
  same_name "which is read (IN)" sample in.ply new.csv --radius 0.3 --json $same
  same_name "which is read (IN)" gaps in.ply in.xyzr $same
  same_name "which is read (IN)" info in.ply --json $same
  same_name "which is read (IN)" fill in.ply none $same --radius 0.3
  same_name "which is read (IN)" fill in.ply in.xyzr new.csv --added $same
  same_name "which is read (IN)" fill in.ply in.xyzr new.csv --json $same
  same_name "which is read (IN)" quality in.ply --json $same
  same_name "which is read (IN)" spectrum in.ply in.xyzr --csv $same
  same_name "which is read (IN)" spectrum in.ply in.xyzr --json $same
done
same_name "which is read (SAMPLES)" gaps in.ply in.xyzr --json in.xyzr
same_name "which is read (IN)" curves torus.obj torus.obj
same_name "which is read (--keep)" curves torus.obj box_lines.obj --keep box_lines.obj
same_name "which is read (--keep)" remesh torus.obj box_lines.obj --radius 0.3 --keep box_lines.obj
same_name "which is read (--sizing)" remesh torus.obj new.obj --sizing radii.txt --json radii.txt
same_name "which is read (--sizing)" remesh torus.obj radii.ply --sizing radii.ply:quality
same_name "which is read (--reference)" info in.ply --reference old.ply --json old.ply
ln -s in.ply in.png  # pictures, which are named so
ln -s in.xyzr set.png
same_name "which is read (IN)" quality in.ply --png in.png
same_name "which is read (IN)" spectrum in.ply in.xyzr --png in.png
same_name "which is read (IN)" spectrum in.ply in.xyzr --plot in.png
same_name "which is read (IN)" render in.ply in.png
same_name "which is read (--samples)" render in.ply set.png --samples in.xyzr
same_name "which is read (--added)" render in.ply set.png --added in.xyzr
same_name "which is read (SAMPLES)" fill in.ply in.xyzr in.xyzr
same_name "which is read (SAMPLES)" fill in.ply in.xyzr new.csv --added ./in.xyzr
same_name "which is read (--samples)" quality in.ply --samples in.xyzr --json in.xyzr
same_name "which is read (--samples)" quality in.ply --samples in.xyzr --png set.png
same_name "which is read (SAMPLES)" spectrum in.ply set.ply in.xyzr --csv in.xyzr
same_name "which is read (SAMPLES)" spectrum in.ply in.xyzr set.ply --plot set.png
cp holes.xyzr in.xyzr
run 0 fill torus.obj in.xyzr in.xyzr --overwrite-input
cmp in.xyzr filled.xyzr || fail "filled in place, another set than beside it"
run 0 remesh in.ply in.ply --radius 0.3 --overwrite-input
run 0 remesh old.ply new.ply --radius 0.3
cmp in.ply new.ply || fail "over the input, another result than beside it"
[ "$(ls -i in.ply | cut -d ' ' -f 1)" = "$(ls -i other_name.ply | cut -d ' ' -f 1)" ] || fail "a hard link is lost"
run 0 info in.ply --json /dev/null
run 0 remesh in.ply new.ply --radius 0.3 --json /dev/null --convergence /dev/null
[ -c /dev/null ] || fail "a device is replaced"
rm -f ./link.ply hard.ply old.ply to_input.ply other_name.ply set.png new.* in.*

echo "-- what killed runs left"
printf 'half of a mesh' >.amps-0.tmp
printf 'half of a mesh' >.amps-4.tmp
run 0 make cube sub/../cube.obj --n 100
if [ "$(uname)" = Linux ] && { [ -e .amps-0.tmp ] || [ -e .amps-4.tmp ]; }; then fail "left-overs stay"; fi
# A file that grows too large.
(
  ulimit -f 8
  code=0
  "$amps" make sphere full.obj --n 20000 >log/out 2>log/err || code=$?
  [ $code -eq 2 ] && grep -q "full.obj: cannot be written" log/err && [ ! -e full.obj ]
) || fail "a file too large: $(cat log/err)"
[ -z "$(find . -name '.amps-*')" ] || fail "a temporary is left"

echo "-- the standard input and output"
# piped FILE ARGUMENTS...: amps reads FILE from its standard input, says nothing on stderr and writes log/piped.
piped() {
  from=$1
  shift
  "$amps" "$@" --quiet <"$from" >log/piped 2>log/err || fail "amps $* <$from: $? $(cat log/err)"
  [ ! -s log/err ] || fail "amps $* complains: $(cat log/err)"
}
for extension in obj off ply stl; do
  run 0 make torus io.$extension --n 500
  run 0 remesh io.$extension io_out.$extension --radius 0.2 --samples io.ply --overwrite-input
  run 0 make torus io.$extension --n 500
  piped io.$extension remesh - - --radius 0.2 --format $extension
  cmp log/piped io_out.$extension || fail "$extension: not the same through pipes"
  piped io.$extension remesh - - --radius 0.2 --format=$extension,stl
  run 0 remesh io.$extension io_out.stl --radius 0.2
  cmp log/piped io_out.stl || fail "$extension to stl: not the same through pipes"
  piped io.$extension make torus - --n 500 --format $extension
  cmp log/piped io.$extension || fail "make to the standard output"
done
for extension in xyzr ply csv; do
  run 0 sample torus.obj io_set.$extension --radius 0.2
  piped torus.obj sample - - --radius 0.2 --format obj,$extension
  cmp log/piped io_set.$extension || fail "$extension: not the same samples through a pipe"
  piped io_set.$extension gaps torus.obj - --format $extension
done
head -n 40 io_set.csv >io_holes.csv
run 3 gaps torus.obj io_holes.csv io_gaps.off
"$amps" gaps torus.obj - - --format csv,off <io_holes.csv >log/piped 2>log/err || [ $? -eq 3 ] || fail "gaps through a pipe"
cmp log/piped io_gaps.off || fail "gaps: not the same through pipes"
grep -q '^maximal *no' log/err || fail "the table is not on stderr: $(cat log/err)"
piped marked.obj curves - - --borders free --keep - --format obj
run 0 curves marked.obj io_lines.obj --borders free --keep marked.obj
cmp log/piped io_lines.obj || fail "curves: not the same through pipes"
piped torus.obj info - --format obj --json -
grep -q '"usable": true' log/piped || fail "JSON on the standard output"
run 0 info torus.obj --json io.json
grep -v seconds io.json | cmp - log/piped || fail "another JSON"
piped torus.obj info torus.obj --reference - --format obj --json -
piped edges.obj render - - --size 200 --curves --format obj
cmp log/piped lines.png || fail "not the same picture through pipes"
piped torus.obj remesh torus.obj io.obj --radius 0.2 --samples - --format csv
run 0 remesh torus.obj io.obj --radius 0.2 --samples io.csv
cmp log/piped io.csv || fail "--samples -"
piped torus.obj remesh - io.obj --radius 0.2 --report - --format obj
grep -q '^<title>standard input → io.obj</title>$' log/piped || fail "--report -: $(grep '<title>' log/piped)"
grep -q '</html>' log/piped || fail "--report - is not whole"
piped torus.obj remesh - - --radius 0.2 --report io.html --format obj
grep -q '^<title>standard input → standard output</title>$' io.html || fail "a page of pipes: $(grep '<title>' io.html)"
piped holes.xyzr fill torus.obj - - --format xyzr
cmp log/piped filled.xyzr || fail "fill: not the same through pipes"
piped torus.obj fill - holes.xyzr io.xyzr --added - --format obj,xyzr
cmp log/piped added.xyzr || fail "--added -"
cmp io.xyzr filled.xyzr || fail "fill: not the same with a mesh through a pipe"
run 0 fill torus.obj none io.csv --radius 0.1
piped /dev/null fill torus.obj - - --radius 0.1 --format csv
cmp log/piped io.csv || fail "fill: nothing through a pipe"
piped q.obj quality - --samples q.ply --format obj --png -
cmp log/piped q.png || fail "quality: not the same picture through pipes"
piped q.ply quality q.obj --samples - --format ply --json -
cmp log/piped q.json || fail "quality: not the same JSON through pipes"
run 0 spectrum square.obj square_1.xyzr --csv io.csv --plot io.png
piped square_1.xyzr spectrum square.obj - --format xyzr --csv -
cmp log/piped io.csv || fail "spectrum: not the same through pipes"
piped square.obj spectrum - square_1.xyzr --format obj --plot -
cmp log/piped io.png || fail "spectrum: not the same picture through pipes"
piped set.xyzr render torus.obj - --size 120 --look gaps --no-dots --samples - --format xyzr
cmp log/piped full.png || fail "render: not the same samples through a pipe"
piped holes.xyzr render torus.obj - --size 120 --look gaps --no-dots --samples set.xyzr --added - --format xyzr
cmp log/piped added.png || fail "render: not the same added samples through a pipe"
"$amps" spectrum torus.obj - --csv - --format xyzr <set.xyzr >log/piped 2>log/err || fail "spectrum with a table"
cmp log/piped differences.csv || fail "a table among the curves"
grep -q '^least distance' log/err || fail "the table is not on stderr: $(cat log/err)"
bad "say --radius" fill torus.obj - no.xyzr --format xyzr
bad "say their --format" fill torus.obj - no.xyzr
bad "say their --format" spectrum square.obj -
bad "samples are in" render torus.obj no.png --samples - --format obj
bad "second output" fill torus.obj holes.xyzr - --json - --format xyzr
bad "second output" remesh torus.obj - --radius 0.2 --report - --format obj
bad "second output" spectrum square.obj square_1.xyzr --png - --plot -
bad "name them -" render torus.obj - --format obj
bad "name them -" quality q.obj --png - --format obj
bad "say its --format" info -
bad "say their --format" sample torus.obj - --radius 0.1
bad "a mesh is in" info - --format csv
bad "samples are in" sample torus.obj - --radius 0.1 --format obj
bad "name them -" info torus.obj --format obj
bad "second output" remesh torus.obj - --radius 0.1 --format obj --json -
bad "no lines" curves torus.obj - --format ply
bad "standard input: it is empty\|standard input: no line" info - --format obj
"$amps" make torus - --n 500 --format obj >/dev/full 2>log/err && fail "a full device"
grep -q "standard output: cannot be written" log/err || fail "a full device: $(cat log/err)"

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
bad "ask for fewer --vertices" sample torus.obj no.csv --sizing lfs --vertices 1000000000
bad "use a larger --rmin" sample torus.obj no.csv --sizing lfs --rmin 1e-5 --rmax 1e-5
bad "use a larger --error" sample torus.obj no.csv --error 1e-12

echo "-- interruption"
# interrupted SIGNAL CODE ARGUMENTS...: amps, which would take far longer, stops after a second, says so in one line and changes
# no file.
interrupted() {
  signal=$1
  wanted=$2
  shift 2
  before=$(ls -R .; cat stopped.*)
  code=0
  # In the foreground: else the program's group gets the signal too, and a second one ends it at once.
  timeout --foreground --preserve-status -k 20 -s "$signal" 1 "$amps" "$@" >log/out 2>log/err || code=$?
  [ "$code" -eq "$wanted" ] || fail "amps $* interrupted: returned $code"
  [ "$(cat log/err)" = "amps: interrupted, nothing is written" ] || fail "amps $* interrupted: $(cat log/err)"
  [ ! -s log/out ] || fail "amps $* interrupted: printed $(cat log/out)"
  [ "$before" = "$(ls -R .; cat stopped.*)" ] || fail "amps $* interrupted: changed a file"
}
if command -v timeout >log/which 2>&1; then
  run 0 make knot big.obj --n 300000
  run 0 sample big.obj big.xyzr --radius 0.05
  echo "as it was" >stopped.obj  # one that is there, others that are not
  echo "as it was" | tee stopped.xyzr >stopped.png
  interrupted INT 130 remesh square.obj stopped.obj --radius 0.0005 --samples new.xyzr --json new.json --report new.html
  interrupted INT 130 sample big.obj new.xyzr --sizing lfs --rmin 0.0005 --json new.json
  interrupted INT 130 fill big.obj none stopped.xyzr --radius 0.0025 --added new.csv --json new.json
  interrupted INT 130 info big.obj --reference torus.obj --json new.json
  interrupted TERM 143 remesh square.obj stopped.obj --radius 0.0005 --samples new.xyzr --json new.json
  interrupted TERM 143 fill big.obj none new.xyzr --radius 0.0025 --added new.csv --json new.json
  interrupted INT 130 render torus.obj stopped.png --size 8192
  interrupted INT 130 render big.obj new.png --size 8192 --look cells --samples big.xyzr --legend
  interrupted INT 130 spectrum square.obj square_?.xyzr --max-frequency 8192 --csv new.csv --png stopped.png --plot new.png --json new.json
  interrupted INT 130 spectrum big.obj big.xyzr --range 40 --csv new.csv --plot new.png
fi

[ "$failures" -eq 0 ] || { echo "$failures failed"; exit 1; }
echo "all passed"
