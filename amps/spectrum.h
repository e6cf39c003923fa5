// spectrum.h: how random, how even and how isotropic point sets are — the power spectrum of sets in a square, and the density
// of differences of sets on a surface.
//
//   std::vector<amps::SampleSet> sets;  // ten or more of the same kind, by different seeds
//   amps::SpectrumReport spectrum = amps::spectrum(amps::positions_of(sets));        // in the unit square
//   amps::DifferentialReport differences = amps::differential_spectrum(mesh, sets);  // on any surface
//   amps::write_spectrum(file, spectrum);                                            // CSV
//
// In the plane: the periodogram P(f) = |Σ exp(−2πi f·x_j)|² / n averaged over the sets; its radial mean and anisotropy
// (Ulichney, "Digital halftoning", 1987; Lagae & Dutré, "A comparison of methods for generating Poisson disk distributions",
// CGF 2008); the effective Nyquist frequency and the oscillation (Heck, Schlömer & Deussen, "Blue noise sampling with
// controlled aliasing", ACM TOG 2013). White noise has P = 1. Sums are direct: no transform, no grid that points would be moved
// to. On surfaces: differential-domain analysis (Wei & Wang, "Differential domain analysis for non-uniform sampling", ACM TOG
// 2011).
#pragma once

#include "amps/base.h"
#include "amps/buffers.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/samples.h"

#include <cstdint>
#include <iosfwd>
#include <vector>

namespace amps {

/// What becomes of the border of the square.
enum class SquareBorder {
  /// The square is seen through the window (1 − cos 2πx)(1 − cos 2πy) (Hann): sets that go on beyond it, or end at it, as those
  /// of sample() on a square do. At whole frequencies the window of the mean density is exactly 0 but for the nine where |u|
  /// and |v| are at most 1, which count in no ring. Peaks are three frequencies wide, and neighbours are not independent of
  /// each other.
  kWindow,
  /// The set goes on as itself on all sides, as sets made on a torus do.
  kPeriodic,
};

struct SpectrumOptions {
  /// The square: [x, x + side] × [y, y + side]. Of z nothing is seen.
  double x = 0, y = 0;
  double side = 1;
  SquareBorder border = SquareBorder::kWindow;
  /// Greatest frequency u and v, in periods a side, 4 to 8192; 0: 4 √n, n the mean number of points in the square. (The
  /// oscillation is over frequencies up to 5 √n above the first peak where they are there: as in the paper with 7 √n.)
  Index max_frequency = 0;
  Execution execution;
};

/// Frequencies are in periods a side; power is 1 for white noise.
struct SpectrumReport {
  Index sets = 0;
  double mean_points = 0;  ///< in the square
  Index max_frequency = 0;
  /// By v from −max_frequency to max_frequency, and in each row by u: (2·max_frequency + 1)² numbers. Symmetric about f = 0.
  /// Where |u|, |v| ≤ 1 with a window, or at 0 without one, it is that of the mean density: about n.
  std::vector<double> power;

  /// Rings ring − ½ ≤ |f| < ring + ½, of which there are `rings.size()`: the first is 2 with a window, 1 without, the last
  /// max_frequency.
  std::vector<Index> rings;
  std::vector<Index> frequencies;   ///< in a ring; of f and −f, whose power is equal, one
  std::vector<double> radial_mean;  ///< mean of the power over a ring
  /// 10 log10 of its variance over a ring, relative to the squared mean. Sets without a preferred direction have
  /// −10 log10(sets), up to chance, which is great in the first rings. −infinity where all is equal.
  std::vector<double> anisotropy;

  /// In units of √n/2, the Nyquist frequency of a square grid: half the greatest frequency, below the rise of the spectrum, up
  /// to which the power is less than 0.1 in the mean over a disk. White noise 0, step blue noise at most 0.56, a square grid 1.
  /// 0 if max_frequency is below the rise.
  double effective_nyquist = 0;
  /// 10 times the root of the mean of (P − 1)², P the radial mean, over the frequencies from the first ring with P ≥ 0.98 on,
  /// up to 5 √n more. 0: no oscillation. With few sets, chance adds to it.
  double oscillation = 0;

  double at(Index u, Index v) const;  ///< the power at a frequency; |u|, |v| ≤ max_frequency
};

/// The spectrum of sets of points in a square, averaged over them. With a window, points outside the square do not count.
/// Throws Error: kInvalidArgument (no set; one with no point in the square, or one that is not finite; periodic, and a point
/// outside the square; options out of range), kCancelled. O(n·max_frequency²) a set, shared by the threads: by default O(n²), a
/// quarter of a second for 4,000 points. Memory: 32·max_frequency² bytes. Thread-safe. The result does not depend on the
/// threads: phases are off by at most 1e-15·max_frequency, and each sum is taken in the order of the points.
AMPS_EXPORT SpectrumReport spectrum(const std::vector<PointsView>& sets, const SpectrumOptions& options = {});

/// Views of the positions of sets that outlive them.
AMPS_EXPORT std::vector<PointsView> positions_of(const std::vector<SampleSet>& sets);

/// ring, frequency over √n, radial mean, anisotropy in dB, number of frequencies: one line a ring, after a line of names.
AMPS_EXPORT void write_spectrum(std::ostream& out, const SpectrumReport& report);

struct DifferentialOptions {
  double range = 5;        ///< greatest difference looked at, in radii; > 0
  Index bins = 100;        ///< of its length; ≥ 1
  Index sectors = 18;      ///< of its direction, over half a turn; ≥ 2
  Index image_size = 101;  ///< pixels a side; ≥ 1
  /// Directions are told from where this points to on the tangent plane (or another axis, where it is its normal): on a sphere
  /// around the origin, meridians.
  Vec3 axis = Vec3::UnitZ();
  /// Random points for each sample that say what differences there would be without any order: the surface has borders and is
  /// curved, and radii vary. The more, the less noise; ≥ 1.
  Index references = 8;
  std::uint64_t seed = 1;
  Execution execution;
};

/// Lengths of differences are in radii, of two samples the mean of both.
struct DifferentialReport {
  Index sets = 0;
  double mean_samples = 0;
  double range = 0;
  double min_distance = 0;  ///< the least length of a difference; `range` if there is none

  std::vector<double> distances;  ///< of the middles of the bins
  /// The density of differences of that length over that without order: the pair correlation. 1: no order. 0 in bins without
  /// a difference.
  std::vector<double> radial_mean;
  std::vector<double> pairs;  ///< of samples, over all sets
  /// How much directions differ in number, by bin: 10 log10 of their χ² over its degrees of freedom. 0 dB is chance, and so it
  /// is given where there are fewer than five pairs a sector. Chance leaves about ±10/√sectors·0.6 dB.
  std::vector<double> anisotropy;

  /// The density by direction too: image_size² numbers, rows by the difference across the axis from −range to range, in each
  /// row along the axis. 0 where there is no difference; 1: no order. Symmetric about the middle.
  Index image_size = 0;
  std::vector<double> image;
};

/// The differences p_j − p_i of samples on a surface, as what is seen on the tangent plane at one of them: with the direction
/// projected, and the length corrected to that of a geodesic by the normals n at both ends (Bowers, Wang, Wei & Maletz,
/// "Parallel Poisson disk sampling with spectrum analysis on surfaces", ACM TOG 2010): |d|·(arcsin n_i·e − arcsin n_j·e) /
/// (n_i·e − n_j·e), e = d/|d|: exact in the plane and on a sphere. Pairs whose normals are more than 90° apart are of different
/// sheets and do not count. Facets have to be oriented alike. Samples without a facet belong to the nearest one.
///
/// For the density without order, points of density 1/r² are drawn, r the radius of the nearest sample, and their differences
/// from the samples taken in the same way. So borders and curvature need no correction, and white noise has 1 anywhere.
/// Throws Error: kInvalidMesh (see require_usable), kInvalidArgument (no set; see require_sample_set; options out of range),
/// kCancelled. O(#F + references·n·range²) expected for Poisson-disk sets; sets whose points are far nearer than their radii
/// take O(n²·references). Shared by the threads, on which the result does not depend. Thread-safe.
AMPS_EXPORT DifferentialReport differential_spectrum(const MeshView& mesh, const std::vector<SampleSet>& sets,
                                                     const DifferentialOptions& options = {});
AMPS_EXPORT DifferentialReport differential_spectrum(const MeshView& mesh, const SampleSet& samples,
                                                     const DifferentialOptions& options = {});

/// distance, pair correlation, anisotropy in dB, pairs: one line a bin, after a line of names.
AMPS_EXPORT void write_spectrum(std::ostream& out, const DifferentialReport& report);

}  // namespace amps
