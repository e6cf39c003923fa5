#define AMPS_OWN_SOURCE
#include "amps/mesh_io.h"

#include "amps/file_io.h"
#include "amps/ply.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <istream>
#include <limits>
#include <ostream>
#include <utility>
#include <vector>

namespace amps {
namespace detail {
namespace {

// Columns of a sample file, in the order amps writes them: those of all sets, of sets that know their place on the mesh, and of
// sets that know their place among its curves.
const std::vector<std::string> kSampleColumns = {"x",  "y",  "z",         "radius", "facet",    "b0",
                                                 "b1", "b2", "dimension", "curve",  "parameter"};
constexpr std::size_t kRadiusColumn = 3, kFacetColumn = 4, kDimensionColumn = 8, kCurveColumn = 9, kParameterColumn = 10;
constexpr std::size_t kAllColumns = 11;

// A value for each column; 0 in those that a set does not have.
using SampleRow = std::array<double, kAllColumns>;

// Which columns a set has.
struct ColumnsOfSet {
  bool placed = false;     // facet, b0, b1, b2
  bool on_curves = false;  // dimension, curve, parameter

  bool operator[](std::size_t column) const {
    return column < kFacetColumn || (column < kDimensionColumn ? placed : on_curves);
  }
};

// Those of a file: of a group all columns, or it counts as missing. `has`: is this column there?
template <class Has>
ColumnsOfSet columns_of_file(const Has& has) {
  ColumnsOfSet columns = {true, true};
  for (std::size_t k = kFacetColumn; k < kDimensionColumn; ++k) columns.placed = columns.placed && has(k);
  for (std::size_t k = kDimensionColumn; k < kAllColumns; ++k) columns.on_curves = columns.on_curves && has(k);
  return columns;
}

bool is_index_value(double value) {
  return value >= 0 && value <= std::numeric_limits<Index>::max() && value == std::floor(value);
}

// What is wrong with the place of a sample among the curves, or nullptr.
const char* trouble_on_curves(double dimension, double curve, double parameter) {
  if (dimension != 0 && dimension != 1 && dimension != 2) {
    return "the dimension is not 0 (on a corner), 1 (on a curve) or 2 (on a facet); correct it, or remove the columns "
           "dimension, curve and parameter";
  }
  if (dimension == 2 ? curve != kNone : !is_index_value(curve)) {
    return dimension == 2 ? "a sample of dimension 2 is on no curve; write -1 for the curve, or correct the dimension"
                          : "the number of the curve or corner is not an index; correct it, or remove the columns dimension, "
                            "curve and parameter";
  }
  if (!(parameter >= 0) || !std::isfinite(parameter)) {
    return "the parameter is not a length along a curve: finite, not negative; correct it, or remove the columns dimension, "
           "curve and parameter";
  }
  if (dimension != 1 && parameter != 0) {
    return "a sample that is on no curve has a parameter along one; write 0, or correct the dimension";
  }
  return nullptr;
}

// What is wrong with a row, or nullptr.
const char* trouble_with(const SampleRow& row, const ColumnsOfSet& columns) {
  if (!all_finite(row.data())) return "a coordinate is NaN or infinite; correct or remove the sample";
  if (!(row[kRadiusColumn] > 0) || !std::isfinite(row[kRadiusColumn]))
    return "the radius is not a positive, finite number; correct or remove the sample";
  if (columns.placed && !is_index_value(row[kFacetColumn]))
    return "the facet is not an index; correct it, or remove the columns facet, b0, b1 and b2";
  if (columns.placed && !all_finite(row.data() + kFacetColumn + 1))
    return "a barycentric coordinate is NaN or infinite; correct or remove the sample";
  return columns.on_curves ? trouble_on_curves(row[kDimensionColumn], row[kCurveColumn], row[kParameterColumn]) : nullptr;
}

// Collects the rows of a set, each without trouble.
class SampleBuilder {
 public:
  explicit SampleBuilder(const ColumnsOfSet& columns = {}) : columns_(columns) {}

  void add(const SampleRow& row) {
    coordinates_.insert(coordinates_.end(), row.begin(), row.begin() + kRadiusColumn);
    set_.radii.push_back(row[kRadiusColumn]);
    if (columns_.placed) {
      set_.facets.push_back(static_cast<Index>(row[kFacetColumn]));
      barycentrics_.insert(barycentrics_.end(), row.begin() + kFacetColumn + 1, row.begin() + kDimensionColumn);
    }
    if (columns_.on_curves) {
      set_.dimensions.push_back(static_cast<std::uint8_t>(row[kDimensionColumn]));
      set_.curves.push_back(static_cast<Index>(row[kCurveColumn]));
      set_.parameters.push_back(row[kParameterColumn]);
    }
  }

  /// The set; the builder is empty then.
  SampleSet finish(const IoSource& source) {
    if (set_.radii.empty()) source.fail("it holds no sample; give at least one");
    if (set_.radii.size() > static_cast<std::size_t>(std::numeric_limits<Index>::max())) {
      source.fail("more than 2^31 - 1 samples; cut it into parts", ErrorCode::kTooLarge);
    }
    set_.positions = Points(std::move(coordinates_));
    set_.barycentrics = Points(std::move(barycentrics_));
    return std::move(set_);
  }

 private:
  ColumnsOfSet columns_;
  std::vector<double> coordinates_, barycentrics_;
  SampleSet set_;
};

SampleSet parse_xyzr(const IoSource& source) {
  TextCursor text(source);
  SampleBuilder builder;
  while (text.next_content()) {
    const char* const line = text.p;
    SampleRow row{};
    const int found = text.numbers(row.data(), 4);
    if (found < 4 || text.more_on_line()) {
      source.fail_line(line, "expected 4 numbers \"x y z r\", found " + (found < 4 ? std::to_string(found) : "more") +
                                 cut_short_or_not("a file of samples"));
    }
    if (const char* const what = trouble_with(row, {})) source.fail_line(line, what);
    builder.add(row);
  }
  return builder.finish(source);
}

// The fields of a CSV line, blanks and quotes around them removed.
void split_csv(std::string_view line, std::vector<std::string_view>& fields) {
  fields.clear();
  for (bool more = true; more;) {
    const std::size_t comma = line.find(',');
    more = comma != std::string_view::npos;
    std::string_view field = line.substr(0, comma);
    constexpr std::string_view around = " \t\r\"";
    const std::size_t from = std::min(field.find_first_not_of(around), field.size());
    field.remove_prefix(from);
    field.remove_suffix(field.size() - std::min(field.find_last_not_of(around) + 1, field.size()));
    fields.push_back(field);
    if (more) line.remove_prefix(comma + 1);
  }
}

SampleSet parse_csv_samples(const IoSource& source) {
  TextCursor text(source);
  std::vector<std::string_view> fields;
  const auto next_fields = [&] {
    if (!text.next_content()) return false;
    const char* const line = text.p;
    while (!text.at_end() && !TextCursor::is_line_end(*text.p)) ++text.p;
    split_csv({line, static_cast<std::size_t>(text.p - line)}, fields);
    return true;
  };
  if (!next_fields()) source.fail("it is empty; a CSV file of samples starts with x,y,z,radius");
  constexpr std::size_t missing = static_cast<std::size_t>(-1);
  std::array<std::size_t, kAllColumns> field_of{};
  field_of.fill(missing);
  for (std::size_t i = 0; i < fields.size(); ++i) {
    for (std::size_t k = 0; k < field_of.size(); ++k) {
      const bool match =
          equal_ignoring_case(fields[i], kSampleColumns[k]) || (k == kRadiusColumn && equal_ignoring_case(fields[i], "r"));
      if (match && field_of[k] == missing) field_of[k] = i;
    }
  }
  if (std::count(field_of.begin(), field_of.begin() + kFacetColumn, missing) != 0)
    source.fail_line(fields[0].data(), "expected a header naming x, y, z and radius; add it");
  const ColumnsOfSet columns = columns_of_file([&](std::size_t k) { return field_of[k] != missing; });
  SampleBuilder builder(columns);
  const std::size_t width = fields.size();
  while (next_fields()) {
    const char* const line = fields[0].data();
    if (fields.size() != width) {
      source.fail_line(line, "expected " + std::to_string(width) + " fields, found " + std::to_string(fields.size()) +
                                 cut_short_or_not("a CSV file of samples"));
    }
    SampleRow row{};
    for (std::size_t k = 0; k < kAllColumns; ++k) {
      if (!columns[k]) continue;
      const std::string_view field = fields[field_of[k]];
      if (!parse_double(field.data(), field.data() + field.size(), row[k])) {
        source.fail_line(line, "expected a number, found \"" + TextCursor::shown(field) + "\"; correct or remove the line");
      }
    }
    if (const char* const what = trouble_with(row, columns)) source.fail_line(line, what);
    builder.add(row);
  }
  return builder.finish(source);
}

SampleSet parse_ply_samples(const IoSource& source) {
  const IoSource reading{source.data, source.name, source.run.part(0, 0.7)};
  PlyReader reader(reading);
  MeshBuilder faces(reading);
  const PlyContent content = reader.read(kSampleColumns, faces);
  if (std::count(content.found.begin(), content.found.begin() + kFacetColumn, false) != 0)
    source.fail("its vertices have no x, y, z and radius; it is not a file of samples");
  const ColumnsOfSet columns = columns_of_file([&](std::size_t k) { return content.found[k]; });
  SampleBuilder builder(columns);
  Ticker ticker(source.run.part(0.7, 1), content.at.size(), kRowsPerLook);
  for (std::size_t i = 0; i < content.at.size(); ++i) {
    ticker.tick();
    SampleRow row;
    std::copy_n(content.values.data() + kAllColumns * i, kAllColumns, row.begin());
    if (const char* const what = trouble_with(row, columns)) reader.fail(content.at[i], what);
    builder.add(row);
  }
  return builder.finish(source);
}

[[noreturn]] void fail_to_write(const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "samples: " + what); }

// The columns of a set; throws if it is empty or its arrays differ in length.
ColumnsOfSet columns_of(const SampleSet& samples) {
  const auto n = static_cast<std::size_t>(samples.positions.rows());
  const ColumnsOfSet columns = {!samples.facets.empty(), !samples.dimensions.empty()};
  if (n == 0) fail_to_write("the set is empty; there is nothing to write");
  const std::size_t places = columns.placed ? n : 0, on_curves = columns.on_curves ? n : 0;
  if (samples.radii.size() != n || samples.facets.size() != places ||
      static_cast<std::size_t>(samples.barycentrics.rows()) != places) {
    fail_to_write("positions, radii, facets and barycentrics differ in length; give one of each per sample");
  }
  if (samples.dimensions.size() != on_curves || samples.curves.size() != on_curves || samples.parameters.size() != on_curves)
    fail_to_write("dimensions, curves and parameters are not one of each per sample; give all of them, or none");
  return columns;
}

SampleRow row_of(const SampleSet& samples, const ColumnsOfSet& columns, std::size_t i) {
  const auto r = static_cast<std::ptrdiff_t>(i);
  SampleRow row{};
  for (int k = 0; k < 3; ++k) row[static_cast<std::size_t>(k)] = samples.positions(r, k);
  row[kRadiusColumn] = samples.radii[i];
  if (columns.placed) {
    row[kFacetColumn] = samples.facets[i];
    for (int k = 0; k < 3; ++k) row[kFacetColumn + 1 + static_cast<std::size_t>(k)] = samples.barycentrics(r, k);
  }
  if (columns.on_curves) {
    row[kDimensionColumn] = samples.dimensions[i];
    row[kCurveColumn] = samples.curves[i];
    row[kParameterColumn] = samples.parameters[i];
  }
  return row;
}

const char* ply_type_of(std::size_t column) {
  if (column == kDimensionColumn) return "uchar";
  return column == kFacetColumn || column == kCurveColumn ? "int" : "double";
}

void append_ply_row(std::string& out, const SampleRow& row, const ColumnsOfSet& columns) {
  for (std::size_t k = 0; k < kAllColumns; ++k) {
    if (!columns[k]) continue;
    if (k == kDimensionColumn) {
      append_little_endian<std::uint8_t>(out, static_cast<std::uint8_t>(row[k]));
    } else if (k == kFacetColumn || k == kCurveColumn) {
      append_little_endian<std::uint32_t>(out, static_cast<Index>(row[k]));
    } else {
      append_little_endian<std::uint64_t>(out, row[k]);
    }
  }
}

void append_text_row(std::string& out, const SampleRow& row, const ColumnsOfSet& columns, char separator) {
  for (std::size_t k = 0; k < kAllColumns; ++k) {
    if (!columns[k]) continue;
    if (k > 0) out += separator;
    if (k == kFacetColumn || k == kDimensionColumn || k == kCurveColumn) {
      append_number(out, static_cast<std::int64_t>(row[k]));
    } else {
      append_number(out, row[k]);
    }
  }
  out += '\n';
}

}  // namespace
}  // namespace detail

SampleFormat sample_format(const std::filesystem::path& path) {
  const std::string extension = detail::lower_extension(path);
  if (extension == ".xyzr") return SampleFormat::kXyzr;
  if (extension == ".ply") return SampleFormat::kPly;
  if (extension == ".csv") return SampleFormat::kCsv;
  throw Error(ErrorCode::kFileFormat,
              path.string() + ": \"" + extension + "\" is not an extension of a sample file; use .xyzr, .ply or .csv");
}

SampleSet parse_samples(std::string_view data, SampleFormat format, const std::string& name, const Execution& execution) {
  const Execution run = execution.start("reading");
  const detail::IoSource source{data, name, run};
  SampleSet samples = format == SampleFormat::kPly   ? detail::parse_ply_samples(source)
                      : format == SampleFormat::kCsv ? detail::parse_csv_samples(source)
                                                     : detail::parse_xyzr(source);
  run.finish();
  return samples;
}

SampleSet read_samples(const std::filesystem::path& path, const Execution& execution) {
  const SampleFormat format = sample_format(path);
  const Execution run = execution.start("reading");
  const std::string data = detail::read_whole_file(path, run.part(0, detail::kShareOfDisk));
  SampleSet samples = parse_samples(data, format, path.string(), run.part(detail::kShareOfDisk, 1));
  run.finish();
  return samples;
}

SampleSet read_samples(std::istream& in, SampleFormat format, const std::string& name, const Execution& execution) {
  const Execution run = execution.start("reading");
  const std::string data = detail::read_whole_stream(in, name, 0, run.part(0, detail::kShareOfDisk));
  SampleSet samples = parse_samples(data, format, name, run.part(detail::kShareOfDisk, 1));
  run.finish();
  return samples;
}

std::string format_samples(const SampleSet& samples, SampleFormat format, const Execution& execution) {
  const Execution run = execution.start("writing");
  const detail::ColumnsOfSet has = detail::columns_of(samples);
  const detail::ColumnsOfSet columns = format == SampleFormat::kXyzr ? detail::ColumnsOfSet{} : has;
  const auto n = static_cast<std::size_t>(samples.positions.rows());
  std::string out;
  if (format == SampleFormat::kPly) {
    out = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(n) + '\n';
    for (std::size_t k = 0; k < detail::kAllColumns; ++k) {
      if (columns[k]) out += std::string("property ") + detail::ply_type_of(k) + ' ' + detail::kSampleColumns[k] + '\n';
    }
    out += "end_header\n";
  } else if (format == SampleFormat::kCsv) {
    for (std::size_t k = 0; k < detail::kAllColumns; ++k) {
      if (columns[k]) out += (k > 0 ? "," : "") + detail::kSampleColumns[k];
    }
    out += '\n';
  }
  // A double, or a number and its comma, take some 20 bytes at most.
  const std::size_t width = 4u + (columns.placed ? 4u : 0u) + (columns.on_curves ? 3u : 0u);
  out.reserve(out.size() + (format == SampleFormat::kPly ? 8u : 20u) * width * n);
  detail::Ticker ticker(run, n, detail::kRowsPerLook);
  for (std::size_t i = 0; i < n; ++i) {
    ticker.tick();
    const detail::SampleRow row = detail::row_of(samples, columns, i);
    if (const char* const what = detail::trouble_with(row, columns))
      detail::fail_to_write("sample " + std::to_string(i) + ": " + what);
    if (format == SampleFormat::kPly) {
      detail::append_ply_row(out, row, columns);
    } else {
      detail::append_text_row(out, row, columns, format == SampleFormat::kCsv ? ',' : ' ');
    }
  }
  run.finish();
  return out;
}

void write_samples(const std::filesystem::path& path, const SampleSet& samples, const Execution& execution) {
  const SampleFormat format = sample_format(path);
  const Execution run = execution.start("writing");
  const std::string data = format_samples(samples, format, run.part(0, 1 - detail::kShareOfDisk));
  detail::replace_file(path, data, run.part(1 - detail::kShareOfDisk, 1));
  run.finish();
}

void write_samples(std::ostream& out, const SampleSet& samples, SampleFormat format, const Execution& execution) {
  const Execution run = execution.start("writing");
  const std::string data = format_samples(samples, format, run.part(0, 1 - detail::kShareOfDisk));
  detail::write_whole_stream(out, data, run.part(1 - detail::kShareOfDisk, 1));
  run.finish();
}

std::vector<double> parse_values(std::string_view data, const std::string& name, const Execution& execution) {
  const Execution run = execution.start("reading");
  const detail::IoSource source{data, name, run};
  detail::TextCursor cursor(source);
  std::vector<double> values;
  while (cursor.next_content()) {
    const char* const where = cursor.p;
    double value = 0;
    cursor.numbers(&value, 1);
    if (!std::isfinite(value)) source.fail_line(where, "a value is NaN, infinite or too large for a double; correct it");
    values.push_back(value);
  }
  if (values.empty()) source.fail("no number in it; give one a vertex");
  run.finish();
  return values;
}

std::vector<double> parse_vertex_property(std::string_view data, const std::string& property, const std::string& name,
                                          const Execution& execution) {
  const Execution run = execution.start("reading");
  const detail::IoSource source{data, name, run};
  detail::PlyReader reader(source);
  detail::MeshBuilder faces(source);
  detail::PlyContent content = reader.read({property}, faces);
  if (!content.found[0]) source.fail("its vertices have no property " + property);
  for (std::size_t i = 0; i < content.at.size(); ++i) {
    if (!std::isfinite(content.values[i]))
      reader.fail(content.at[i], "the property " + property + " is NaN or infinite; correct it");
  }
  run.finish();
  return std::move(content.values);
}

std::vector<double> read_vertex_property(const std::filesystem::path& path, const std::string& property,
                                         const Execution& execution) {
  const Execution run = execution.start("reading");
  const std::string data = detail::read_whole_file(path, run.part(0, detail::kShareOfDisk));
  std::vector<double> values = parse_vertex_property(data, property, path.string(), run.part(detail::kShareOfDisk, 1));
  run.finish();
  return values;
}

std::vector<double> read_values(const std::filesystem::path& path, const Execution& execution) {
  const Execution run = execution.start("reading");
  const std::string data = detail::read_whole_file(path, run.part(0, detail::kShareOfDisk));
  std::vector<double> values = parse_values(data, path.string(), run.part(detail::kShareOfDisk, 1));
  run.finish();
  return values;
}

}  // namespace amps
