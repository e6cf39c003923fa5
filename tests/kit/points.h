// points.h: points, triangles and lists of numbers as wholes: made, joined, cut, moved and compared. Tests use these rather
// than the operations of a matrix, so that what the library keeps them in is known here alone.
#pragma once

#include "basics.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <initializer_list>
#include <vector>

namespace amps_test {

/// One number a point: radii, weights.
using Values = std::vector<double>;

using Corners = std::array<Index, 3>;  ///< of a triangle

// Points.

/// Row i is `make(i)`, called in order.
template <class Make>
Points made_points(Index n, const Make& make) {
  Points points(n, 3);
  for (Index i = 0; i < n; ++i) points.row(i) = Vec3(make(i)).transpose();
  return points;
}

inline Points points_of(const std::vector<Vec3>& list) {
  return made_points(static_cast<Index>(list.size()), [&](Index i) { return list[at(i)]; });
}

inline Points no_points() { return Points(0, 3); }

/// All coordinates `x`.
inline Points constant_points(Index n, double x) {
  return made_points(n, [x](Index) { return Vec3::Constant(x); });
}

inline Index rows(const Points& points) { return static_cast<Index>(points.rows()); }

inline Vec3 point_at(const Points& points, Index i) { return points.row(i).transpose(); }

template <class Map>
Points transformed(const Points& points, const Map& map) {
  return made_points(rows(points), [&](Index i) { return map(point_at(points, i)); });
}

inline Points scaled(const Points& points, double factor) {
  return transformed(points, [factor](const Vec3& x) -> Vec3 { return x * factor; });
}

inline Points moved(const Points& points, const Vec3& by) {
  return transformed(points, [&by](const Vec3& x) -> Vec3 { return x + by; });
}

inline Points chosen(const Points& points, const std::vector<Index>& rows) {
  return made_points(static_cast<Index>(rows.size()), [&](Index i) { return point_at(points, rows[at(i)]); });
}

inline Points head(const Points& points, Index n) {
  return made_points(n, [&](Index i) { return point_at(points, i); });
}

inline Points tail(const Points& points, Index n) {
  return made_points(n, [&](Index i) { return point_at(points, rows(points) - n + i); });
}

inline Points joined(const Points& a, const Points& b) {
  return made_points(rows(a) + rows(b), [&](Index i) { return i < rows(a) ? point_at(a, i) : point_at(b, i - rows(a)); });
}

inline amps::Box box_of(const Points& points) {
  amps::Box box{point_at(points, 0), point_at(points, 0)};
  for (Index i = 1; i < rows(points); ++i) {
    box.min = box.min.cwiseMin(point_at(points, i));
    box.max = box.max.cwiseMax(point_at(points, i));
  }
  return box;
}

// Triangles.

template <class Make>
Triangles made_triangles(Index n, const Make& make) {
  Triangles triangles(n, 3);
  for (Index f = 0; f < n; ++f) {
    const Corners corners = make(f);
    for (int k = 0; k < 3; ++k) triangles(f, k) = corners[static_cast<std::size_t>(k)];
  }
  return triangles;
}

inline Triangles triangles_of(const std::vector<Corners>& list) {
  return made_triangles(static_cast<Index>(list.size()), [&](Index f) { return list[at(f)]; });
}

inline Triangles no_triangles() { return Triangles(0, 3); }

inline Index rows(const Triangles& triangles) { return static_cast<Index>(triangles.rows()); }

inline Corners corners_of(const Triangles& triangles, Index f) { return {triangles(f, 0), triangles(f, 1), triangles(f, 2)}; }

inline Triangles chosen(const Triangles& triangles, const std::vector<Index>& rows) {
  return made_triangles(static_cast<Index>(rows.size()), [&](Index f) { return corners_of(triangles, rows[at(f)]); });
}

inline Triangles head(const Triangles& triangles, Index n) {
  return made_triangles(n, [&](Index f) { return corners_of(triangles, f); });
}

inline Triangles joined(const Triangles& a, const Triangles& b) {
  return made_triangles(rows(a) + rows(b),
                        [&](Index f) { return f < rows(a) ? corners_of(a, f) : corners_of(b, f - rows(a)); });
}

inline Index least_index(const Triangles& triangles) {
  return *std::min_element(triangles.data(), triangles.data() + triangles.size());
}
inline Index greatest_index(const Triangles& triangles) {
  return *std::max_element(triangles.data(), triangles.data() + triangles.size());
}

/// Each index v becomes `map(v)`.
template <class Map>
Triangles renumbered(const Triangles& triangles, const Map& map) {
  return made_triangles(rows(triangles), [&](Index f) {
    const Corners c = corners_of(triangles, f);
    return Corners{map(c[0]), map(c[1]), map(c[2])};
  });
}

// Values.

template <class Make>
Values made_values(Index n, const Make& make) {
  Values values(at(n));
  for (Index i = 0; i < n; ++i) values[at(i)] = make(i);
  return values;
}

inline Values values_of(std::initializer_list<double> list) {
  return made_values(static_cast<Index>(list.size()), [&](Index i) { return *(list.begin() + i); });
}

inline Values constant_values(Index n, double x) {
  return made_values(n, [x](Index) { return x; });
}

inline Index rows(const Values& values) { return static_cast<Index>(values.size()); }

template <class Map>
Values transformed(const Values& values, const Map& map) {
  return made_values(rows(values), [&](Index i) { return map(values[i]); });
}

inline Values scaled(const Values& values, double factor) {
  return transformed(values, [factor](double x) { return x * factor; });
}

inline Values squared(const Values& values) {
  return transformed(values, [](double x) { return x * x; });
}

inline Values chosen(const Values& values, const std::vector<Index>& rows) {
  return made_values(static_cast<Index>(rows.size()), [&](Index i) { return values[rows[at(i)]]; });
}

inline Values head(const Values& values, Index n) {
  return made_values(n, [&](Index i) { return values[i]; });
}

inline Values tail(const Values& values, Index n) {
  return made_values(n, [&](Index i) { return values[rows(values) - n + i]; });
}

inline Values joined(const Values& a, const Values& b) {
  return made_values(rows(a) + rows(b), [&](Index i) { return i < rows(a) ? a[i] : b[i - rows(a)]; });
}

inline double min_of(const Values& values) { return *std::min_element(values.data(), values.data() + values.size()); }
inline double max_of(const Values& values) { return *std::max_element(values.data(), values.data() + values.size()); }

inline double mean_of(const Values& values) {
  double sum = 0;
  for (Index i = 0; i < rows(values); ++i) sum += values[i];
  return sum / rows(values);
}

inline bool all_equal(const Values& values, double x) {
  return std::all_of(values.data(), values.data() + values.size(), [x](double value) { return value == x; });
}

// Comparison. Values that compare equal may differ in bits (0 and −0), and the other way round (NaN).

inline bool same_bits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0; }
inline bool same_bits(const Vec3& a, const Vec3& b) { return std::memcmp(a.data(), b.data(), 3 * sizeof(double)) == 0; }

inline bool same_bits(const Points& a, const Points& b) {
  return a.rows() == b.rows() &&
         std::equal(a.data(), a.data() + a.size(), b.data(), [](double x, double y) { return same_bits(x, y); });
}

template <class List>
bool same_values(const List& a, const List& b) {
  return a.size() == b.size() && std::equal(a.data(), a.data() + a.size(), b.data());
}

inline bool all_zero(const Points& points) {
  return std::all_of(points.data(), points.data() + points.size(), [](double x) { return x == 0; });
}

/// (2, 3, 6)/7 is a unit vector: a rotation of rational coefficients.
inline Eigen::Matrix3d some_rotation() {
  Eigen::Matrix3d r;
  r << 2, 3, 6, 3, -6, 2, 6, 2, -3;
  return r / 7;
}

}  // namespace amps_test
