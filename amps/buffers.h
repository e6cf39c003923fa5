// buffers.h: memory at the border of the library — plain tables that results own, and views of whatever the caller has.
//
// A program's compiler flags are not ours. Eigen's own allocations depend on them (-mavx changes what `free` expects), so
// nothing here, and nothing else that crosses the border, owns an Eigen object: a Table is a std::vector with a shape, seen
// through Eigen maps. A view is pointers, a stride and a count. It takes positions in float or double, indices of 16, 32 or 64
// bits, row after row, interleaved with other things or column after column, and copies nothing; the memory must outlive it.
// Temporary tables and vectors are taken over, so a view of one does not dangle. What has no memory to look at does not
// compile.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace amps {

namespace detail {

template <class T>
using Bare = std::remove_cv_t<std::remove_reference_t<T>>;

template <class D>
std::true_type eigen_test(const Eigen::EigenBase<D>*);
std::false_type eigen_test(...);
/// Anything of Eigen: matrices, maps, expressions.
template <class T>
inline constexpr bool is_eigen = decltype(eigen_test(static_cast<Bare<T>*>(nullptr)))::value;

template <class D>
std::true_type plain_test(const Eigen::PlainObjectBase<D>*);
std::false_type plain_test(...);
/// An Eigen object that owns its coefficients.
template <class T>
inline constexpr bool is_plain_eigen = decltype(plain_test(static_cast<Bare<T>*>(nullptr)))::value;

/// An Eigen object whose coefficients lie in memory.
template <class T>
inline constexpr bool has_memory = (static_cast<unsigned>(Eigen::internal::traits<Bare<T>>::Flags) & Eigen::DirectAccessBit) !=
                                   0;

/// "No such memory" errors of the views below, at compile time, with the remedy.
template <class Matrix, bool scalar_fits>
constexpr void require_viewable() {
  using M = Bare<Matrix>;
  static_assert(scalar_fits,
                "amps: this scalar type cannot be viewed. Positions and values are float or double, indices are integers of "
                "16, 32 or 64 bits: "
                "convert into a matrix of such a type that outlives the view");
  static_assert(has_memory<M>,
                "amps: an Eigen expression (cast<>(), a sum, Constant(), ...) has no memory of its own to view. Evaluate it "
                "into a matrix that "
                "outlives the view: Eigen::MatrixXd V = expression;");
  static_assert(
      !is_plain_eigen<M> || std::is_lvalue_reference_v<Matrix>,
      "amps: this matrix is a temporary, and the view would outlive it. Give it a name first: Eigen::MatrixXd V = ...;");
}

/// What three numbers side by side are made of; void for other types.
template <class T>
struct TripleOf {
  using Scalar = void;
};
template <class S>
struct TripleOf<std::array<S, 3>> {
  using Scalar = S;
};
template <class S, int Options>
struct TripleOf<Eigen::Matrix<S, 3, 1, Options, 3, 1>> {
  using Scalar = S;
};
template <class S, int Options>
struct TripleOf<Eigen::Matrix<S, 1, 3, Options, 1, 3>> {
  using Scalar = S;
};
template <class T>
using TripleScalar = typename TripleOf<T>::Scalar;

template <class T>
std::ptrdiff_t count_of(const std::vector<T>& values) {
  return static_cast<std::ptrdiff_t>(values.size());
}

/// Keeps a temporary for as long as there are views of it.
template <class Owner>
std::shared_ptr<const Owner> take_over(Owner&& temporary) {
  return std::make_shared<const Owner>(std::move(temporary));
}

}  // namespace detail

/// n rows of N numbers, row after row without gaps: what results own. A value. Indexed and resized like a row-major Eigen
/// matrix of N columns; map() sees it as one, row(i) a row of it. Converts from any Eigen matrix or expression of N columns, by
/// copying.
template <class T, int N>
class Table {
 public:
  using Scalar = T;
  using EigenMap = Eigen::Map<Eigen::Matrix<T, Eigen::Dynamic, N, Eigen::RowMajor>>;
  using ConstEigenMap = Eigen::Map<const Eigen::Matrix<T, Eigen::Dynamic, N, Eigen::RowMajor>>;
  using Row = Eigen::Map<Eigen::Matrix<T, 1, N, Eigen::RowMajor>>;
  using ConstRow = Eigen::Map<const Eigen::Matrix<T, 1, N, Eigen::RowMajor>>;

  Table() = default;
  /// `rows` rows of zeros.
  explicit Table(std::ptrdiff_t rows, int cols = N) { resize(rows, cols); }
  /// Takes the numbers over. Throws Error(kInvalidArgument) if they do not fill rows.
  explicit Table(std::vector<T> values) : values_(std::move(values)) {
    if (values_.size() % N != 0) {
      throw Error(ErrorCode::kInvalidArgument,
                  "amps: " + std::to_string(values_.size()) + " numbers do not make rows of " + std::to_string(N));
    }
  }
  /// Copies. Throws Error(kInvalidArgument) for another number of columns, or an integer that does not fit.
  template <class Matrix, class = std::enable_if_t<detail::is_eigen<Matrix>>>
  Table(const Matrix& matrix) {  // NOLINT: implicit, as between Eigen's own matrices
    assign(matrix);
  }

  std::ptrdiff_t rows() const { return static_cast<std::ptrdiff_t>(values_.size()) / N; }
  static constexpr std::ptrdiff_t cols() { return N; }
  std::ptrdiff_t size() const { return static_cast<std::ptrdiff_t>(values_.size()); }  ///< rows() · N
  bool empty() const { return values_.empty(); }

  T* data() { return values_.data(); }
  const T* data() const { return values_.data(); }
  T& operator()(std::ptrdiff_t row, std::ptrdiff_t col) { return values_[static_cast<std::size_t>(row * N + col)]; }
  const T& operator()(std::ptrdiff_t row, std::ptrdiff_t col) const { return values_[static_cast<std::size_t>(row * N + col)]; }

  Row row(std::ptrdiff_t i) { return Row(data() + i * N); }
  ConstRow row(std::ptrdiff_t i) const { return ConstRow(data() + i * N); }
  EigenMap map() { return EigenMap(data(), rows(), N); }
  ConstEigenMap map() const { return ConstEigenMap(data(), rows(), N); }

  /// Rows that are there stay; new ones are zeros. `cols` must be N.
  void resize(std::ptrdiff_t rows, int cols = N) {
    if (cols != N || rows < 0)
      throw Error(ErrorCode::kInvalidArgument, "amps: a table of " + std::to_string(N) + " columns cannot be resized so");
    values_.resize(static_cast<std::size_t>(rows) * N);
  }
  void reserve(std::ptrdiff_t rows) { values_.reserve(static_cast<std::size_t>(rows) * N); }

  friend bool operator==(const Table& a, const Table& b) { return a.values_ == b.values_; }
  friend bool operator!=(const Table& a, const Table& b) { return !(a == b); }

 private:
  template <class Matrix>
  void assign(const Matrix& matrix) {
    using S = typename Matrix::Scalar;
    static_assert(Matrix::ColsAtCompileTime == N || Matrix::ColsAtCompileTime == Eigen::Dynamic,
                  "amps: the matrix has another number of columns than the table; a 3 by n matrix must be transposed");
    static_assert(std::is_integral_v<T> == std::is_integral_v<S>,
                  "amps: indices come from integers, positions from float or double");
    if (matrix.cols() != N) {
      throw Error(ErrorCode::kInvalidArgument, "amps: the matrix has " + std::to_string(matrix.cols()) + " columns; " +
                                                   std::to_string(N) + " are needed, one row a point or triangle");
    }
    resize(matrix.rows());
    if constexpr (std::is_same_v<S, T>) {
      map() = matrix;
    } else {
      const auto values = matrix.template cast<T>();
      if constexpr (std::is_integral_v<T>) {
        const bool same_sign = std::is_signed_v<S> || (values.array() >= 0).all();
        if (!same_sign || !(values.template cast<S>().array() == matrix.array()).all()) {
          throw Error(ErrorCode::kInvalidArgument, "amps: an index does not fit into 32 bits");
        }
      }
      map() = values;
    }
  }

  std::vector<T> values_;
};

/// #P by 3 list of positions, one row a point.
using Points = Table<double, 3>;
/// #F by 3 list of vertex indices, one row a triangle, zero-based, counter-clockwise seen from outside.
using Triangles = Table<Index, 3>;
/// #C by 4 list of vertex indices, one row a tetrahedron.
using Tetrahedra = Table<Index, 4>;

namespace detail {

/// Reads a number wherever it lies.
template <class T>
T load(const unsigned char* at) noexcept {
  T value;
  std::memcpy(&value, at, sizeof value);
  return value;
}

/// Columns in somebody else's memory: coefficient (i, k) lies at column[k] + i · stride, in bytes.
template <std::size_t N>
struct Columns {
  std::array<const unsigned char*, N> column{};
  std::ptrdiff_t stride = 0;
  std::ptrdiff_t rows = 0;

  template <class T>
  static Columns interleaved(const T* first, std::ptrdiff_t rows, std::ptrdiff_t stride) {
    Columns result;
    for (std::size_t k = 0; k < N; ++k) result.column[k] = reinterpret_cast<const unsigned char*>(first + k);
    result.stride = stride;
    result.rows = rows;
    return result;
  }

  template <class Matrix>
  static Columns of_matrix(const Matrix& matrix, const char* what) {
    using S = typename Matrix::Scalar;
    constexpr int kCols = Matrix::ColsAtCompileTime, kRows = Matrix::RowsAtCompileTime;
    constexpr bool kAsVector = N == 1 && kRows == 1;
    static_assert(kAsVector || kCols == static_cast<int>(N) || (kCols == Eigen::Dynamic && (N == 1 || kRows != 3)),
                  "amps: one row a point or triangle, three columns; of a matrix with 3 rows view m.transpose()");
    const std::ptrdiff_t row_stride = Matrix::IsRowMajor ? matrix.outerStride() : matrix.innerStride();
    const std::ptrdiff_t col_stride = Matrix::IsRowMajor ? matrix.innerStride() : matrix.outerStride();
    if (!kAsVector && matrix.cols() != static_cast<Eigen::Index>(N)) {
      throw Error(ErrorCode::kInvalidArgument,
                  std::string(what) + ": a matrix of " + std::to_string(matrix.rows()) + " by " +
                      std::to_string(matrix.cols()) + "; it needs " + std::to_string(N) +
                      (N == 1 ? " column" : " columns, one row each") +
                      (matrix.rows() == 3 && N == 3 ? " (of a matrix with 3 rows, give m.transpose())" : ""));
    }
    Columns result;
    for (std::size_t k = 0; k < N; ++k) {
      result.column[k] = reinterpret_cast<const unsigned char*>(matrix.data() + static_cast<std::ptrdiff_t>(k) * col_stride);
    }
    result.stride = (kAsVector ? col_stride : row_stride) * static_cast<std::ptrdiff_t>(sizeof(S));
    result.rows = matrix.size() / static_cast<std::ptrdiff_t>(N);
    return result;
  }
};

template <class T>
inline constexpr bool is_real = std::is_same_v<T, double> || std::is_same_v<T, float>;
template <class T>
inline constexpr bool is_index = [] {
  if constexpr (std::is_integral_v<T>) return sizeof(T) == 2 || sizeof(T) == 4 || sizeof(T) == 8;
  return false;
}();

}  // namespace detail

/// #P by 3 positions of the caller's, float or double. Copying a view copies no position; const members may be called
/// concurrently.
class PointsView {
 public:
  PointsView() = default;

  /// Points interleaved with other things, or not: x, y, z side by side, the next point `stride` bytes on.
  PointsView(const double* xyz, std::ptrdiff_t count, std::ptrdiff_t stride = 3 * sizeof(double))
      : memory_(detail::Columns<3>::interleaved(xyz, count, stride)) {}
  PointsView(const float* xyz, std::ptrdiff_t count, std::ptrdiff_t stride = 3 * sizeof(float))
      : memory_(detail::Columns<3>::interleaved(xyz, count, stride)), is_float_(true) {}

  /// Coordinates in columns of their own.
  template <class T>
  static PointsView columns(const T* x, const T* y, const T* z, std::ptrdiff_t count, std::ptrdiff_t stride = sizeof(T)) {
    static_assert(detail::is_real<T>, "amps: positions are float or double");
    PointsView view;
    view.memory_.column = {reinterpret_cast<const unsigned char*>(x), reinterpret_cast<const unsigned char*>(y),
                           reinterpret_cast<const unsigned char*>(z)};
    view.memory_.stride = stride;
    view.memory_.rows = count;
    view.is_float_ = std::is_same_v<T, float>;
    return view;
  }

  PointsView(const Points& points)  // NOLINT: implicit by design, as all that follow
      : PointsView(points.data(), points.rows()) {}
  PointsView(Points&& points) : PointsView(detail::take_over(std::move(points))) {}  // NOLINT
  /// Of vectors of Eigen::Vector3d, Vector3f, std::array<float, 3> and their like.
  template <class Triple, class = std::enable_if_t<detail::is_real<detail::TripleScalar<Triple>>>>
  PointsView(const std::vector<Triple>& points)  // NOLINT
      : PointsView(reinterpret_cast<const detail::TripleScalar<Triple>*>(points.data()), detail::count_of(points)) {}
  template <class Triple, class = std::enable_if_t<detail::is_real<detail::TripleScalar<Triple>>>>
  PointsView(std::vector<Triple>&& points)  // NOLINT
      : PointsView(detail::take_over(std::move(points))) {}

  /// Of Eigen matrices, maps, blocks and transposes of either storage order. Throws Error(kInvalidArgument) unless there are 3
  /// columns.
  template <class Matrix, class = std::enable_if_t<detail::is_eigen<Matrix>>>
  PointsView(Matrix&& matrix) {  // NOLINT
    using S = typename detail::Bare<Matrix>::Scalar;
    detail::require_viewable<Matrix, detail::is_real<S>>();
    if constexpr (detail::has_memory<Matrix>) memory_ = detail::Columns<3>::of_matrix(matrix, "positions");
    is_float_ = std::is_same_v<S, float>;
  }

  std::ptrdiff_t rows() const noexcept { return memory_.rows; }

  Vec3 operator[](std::ptrdiff_t i) const noexcept {
    const std::ptrdiff_t at = i * memory_.stride;
    const auto& column = memory_.column;
    using detail::load;
    if (!is_float_) return {load<double>(column[0] + at), load<double>(column[1] + at), load<double>(column[2] + at)};
    return Eigen::Vector3f(load<float>(column[0] + at), load<float>(column[1] + at), load<float>(column[2] + at))
        .cast<double>();
  }
  double operator()(std::ptrdiff_t i, int k) const noexcept {
    const unsigned char* const at = memory_.column[static_cast<std::size_t>(k)] + i * memory_.stride;
    return is_float_ ? static_cast<double>(detail::load<float>(at)) : detail::load<double>(at);
  }

  /// The same points in the same order, whatever the memory is like.
  friend bool operator==(const PointsView& a, const PointsView& b) noexcept {
    bool same = a.rows() == b.rows();
    for (std::ptrdiff_t i = 0; same && i < a.rows(); ++i) same = a[i] == b[i];
    return same;
  }
  friend bool operator!=(const PointsView& a, const PointsView& b) noexcept { return !(a == b); }

  /// Where the x of point i lies.
  const void* address(std::ptrdiff_t i) const noexcept { return memory_.column[0] + i * memory_.stride; }

 private:
  template <class Owner>
  explicit PointsView(std::shared_ptr<const Owner> owner) : PointsView(*owner) {
    owner_ = std::move(owner);
  }

  detail::Columns<3> memory_;
  bool is_float_ = false;
  std::shared_ptr<const void> owner_;  ///< of a temporary that was taken over
};

/// #F by 3 vertex indices of the caller's, integers of 16, 32 or 64 bits with or without sign.
class TrianglesView {
 public:
  TrianglesView() = default;

  /// The three corners side by side, the next triangle `stride` bytes on.
  template <class T, class = std::enable_if_t<detail::is_index<T>>>
  TrianglesView(const T* corners, std::ptrdiff_t count, std::ptrdiff_t stride = 3 * sizeof(T))
      : memory_(detail::Columns<3>::interleaved(corners, count, stride)), type_(type_of<T>()) {}

  /// Corners in columns of their own.
  template <class T>
  static TrianglesView columns(const T* a, const T* b, const T* c, std::ptrdiff_t count, std::ptrdiff_t stride = sizeof(T)) {
    static_assert(detail::is_index<T>, "amps: indices are integers of 16, 32 or 64 bits");
    TrianglesView view;
    view.memory_.column = {reinterpret_cast<const unsigned char*>(a), reinterpret_cast<const unsigned char*>(b),
                           reinterpret_cast<const unsigned char*>(c)};
    view.memory_.stride = stride;
    view.memory_.rows = count;
    view.type_ = type_of<T>();
    return view;
  }

  TrianglesView(const Triangles& triangles)  // NOLINT: implicit by design, as all that follow
      : TrianglesView(triangles.data(), triangles.rows()) {}
  TrianglesView(Triangles&& triangles) : TrianglesView(detail::take_over(std::move(triangles))) {}  // NOLINT
  /// Of vectors of Eigen::Vector3i, std::array<std::uint16_t, 3> and their like.
  template <class Triple, class = std::enable_if_t<detail::is_index<detail::TripleScalar<Triple>>>>
  TrianglesView(const std::vector<Triple>& triangles)  // NOLINT
      : TrianglesView(reinterpret_cast<const detail::TripleScalar<Triple>*>(triangles.data()), detail::count_of(triangles)) {}
  template <class Triple, class = std::enable_if_t<detail::is_index<detail::TripleScalar<Triple>>>>
  TrianglesView(std::vector<Triple>&& triangles)  // NOLINT
      : TrianglesView(detail::take_over(std::move(triangles))) {}

  /// Of Eigen matrices, maps, blocks and transposes of either storage order. Throws Error(kInvalidArgument) unless there are 3
  /// columns.
  template <class Matrix, class = std::enable_if_t<detail::is_eigen<Matrix>>>
  TrianglesView(Matrix&& matrix) {  // NOLINT
    using S = typename detail::Bare<Matrix>::Scalar;
    detail::require_viewable<Matrix, detail::is_index<S>>();
    if constexpr (detail::has_memory<Matrix>) memory_ = detail::Columns<3>::of_matrix(matrix, "triangles");
    if constexpr (detail::is_index<S>) type_ = type_of<S>();
  }

  std::ptrdiff_t rows() const noexcept { return memory_.rows; }

  /// Corner k of triangle i; below 0 where the number does not fit an Index.
  Index operator()(std::ptrdiff_t i, int k) const noexcept {
    const unsigned char* const at = memory_.column[static_cast<std::size_t>(k)] + i * memory_.stride;
    return type_ == Type::kInt32 ? detail::load<std::int32_t>(at) : converted(at);
  }
  std::array<Index, 3> operator[](std::ptrdiff_t i) const noexcept { return {(*this)(i, 0), (*this)(i, 1), (*this)(i, 2)}; }

  /// The same triangles in the same order, whatever the memory is like.
  friend bool operator==(const TrianglesView& a, const TrianglesView& b) noexcept {
    bool same = a.rows() == b.rows();
    for (std::ptrdiff_t i = 0; same && i < a.rows(); ++i) same = a[i] == b[i];
    return same;
  }
  friend bool operator!=(const TrianglesView& a, const TrianglesView& b) noexcept { return !(a == b); }

  /// Where the first corner of triangle i lies.
  const void* address(std::ptrdiff_t i) const noexcept { return memory_.column[0] + i * memory_.stride; }

 private:
  template <class Owner>
  explicit TrianglesView(std::shared_ptr<const Owner> owner) : TrianglesView(*owner) {
    owner_ = std::move(owner);
  }

  enum class Type : std::uint8_t { kInt16, kUint16, kInt32, kUint32, kInt64, kUint64 };
  template <class T>
  static constexpr Type type_of() {
    constexpr int kLog = sizeof(T) == 2 ? 0 : sizeof(T) == 4 ? 2 : 4;
    return static_cast<Type>(kLog + (std::is_signed_v<T> ? 0 : 1));
  }
  /// Of the types that are not Index.
  AMPS_EXPORT Index converted(const unsigned char* at) const noexcept;

  detail::Columns<3> memory_;
  Type type_ = Type::kInt32;
  std::shared_ptr<const void> owner_;
};

/// A list of numbers of the caller's, float or double.
class ValuesView {
 public:
  ValuesView() = default;
  ValuesView(const double* values, std::ptrdiff_t count, std::ptrdiff_t stride = sizeof(double))
      : memory_(detail::Columns<1>::interleaved(values, count, stride)) {}
  ValuesView(const float* values, std::ptrdiff_t count, std::ptrdiff_t stride = sizeof(float))
      : memory_(detail::Columns<1>::interleaved(values, count, stride)), is_float_(true) {}
  template <class T, class = std::enable_if_t<detail::is_real<T>>>
  ValuesView(const std::vector<T>& values)  // NOLINT: implicit by design
      : ValuesView(values.data(), detail::count_of(values)) {}
  template <class T, class = std::enable_if_t<detail::is_real<T>>>
  ValuesView(std::vector<T>&& values)  // NOLINT
      : ValuesView(detail::take_over(std::move(values))) {}
  /// Of Eigen vectors, and matrices of one column.
  template <class Matrix, class = std::enable_if_t<detail::is_eigen<Matrix>>>
  ValuesView(Matrix&& matrix) {  // NOLINT
    using S = typename detail::Bare<Matrix>::Scalar;
    detail::require_viewable<Matrix, detail::is_real<S>>();
    if constexpr (detail::has_memory<Matrix>) memory_ = detail::Columns<1>::of_matrix(matrix, "values");
    is_float_ = std::is_same_v<S, float>;
  }

  std::ptrdiff_t size() const noexcept { return memory_.rows; }
  double operator[](std::ptrdiff_t i) const noexcept {
    const unsigned char* const at = memory_.column[0] + i * memory_.stride;
    return is_float_ ? static_cast<double>(detail::load<float>(at)) : detail::load<double>(at);
  }

 private:
  template <class Owner>
  explicit ValuesView(std::shared_ptr<const Owner> owner) : ValuesView(*owner) {
    owner_ = std::move(owner);
  }

  detail::Columns<1> memory_;
  bool is_float_ = false;
  std::shared_ptr<const void> owner_;
};

}  // namespace amps

#include "amps/host_macros_end.h"
