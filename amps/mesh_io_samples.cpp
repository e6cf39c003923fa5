#define AMPS_OWN_SOURCE
#include "amps/mesh_io.h"

#include "amps/file_io.h"
#include "amps/ply.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace amps {
namespace detail {
namespace {

// Columns of a sample file, in the order amps writes them.
const std::vector<std::string> kSampleColumns = {"x", "y", "z", "radius", "facet", "b0", "b1", "b2"};

// Collects rows of `columns` values (4, or 8 with the place on the mesh) and checks them.
struct SampleBuilder {
  std::vector<double> values;
  std::size_t columns = 4;

  // What is wrong with a row, or nullptr.
  static const char* trouble(const double* row, std::size_t columns) {
    if (!all_finite(row)) return "a coordinate is NaN or infinite; correct or remove the sample";
    if (!(row[3] > 0) || !std::isfinite(row[3]))
      return "the radius is not a positive, finite number; correct or remove the sample";
    if (columns == 4) return nullptr;
    const bool facet_ok = row[4] >= 0 && row[4] <= std::numeric_limits<Index>::max() && row[4] == std::floor(row[4]);
    if (!facet_ok) return "the facet is not an index; correct it, or remove the columns facet, b0, b1 and b2";
    return all_finite(row + 5) ? nullptr : "a barycentric coordinate is NaN or infinite; correct or remove the sample";
  }

  SampleSet finish(const IoSource& source, const Execution& run) const {
    const std::size_t n = values.size() / columns;
    if (n == 0) source.fail("it holds no sample; give at least one");
    if (n > static_cast<std::size_t>(std::numeric_limits<Index>::max())) {
      source.fail("more than 2^31 - 1 samples; cut it into parts", ErrorCode::kTooLarge);
    }
    SampleSet samples;
    samples.positions.resize(static_cast<std::ptrdiff_t>(n));
    if (columns == 8) samples.barycentrics.resize(static_cast<std::ptrdiff_t>(n));
    samples.radii.reserve(n);
    if (columns == 8) samples.facets.reserve(n);
    Ticker ticker(run, n, kRowsPerLook);
    for (std::size_t i = 0; i < n; ++i) {
      ticker.tick();
      const double* const row = values.data() + columns * i;
      std::copy_n(row, 3, samples.positions.data() + 3 * i);
      samples.radii.push_back(row[3]);
      if (columns == 8) {
        samples.facets.push_back(static_cast<Index>(row[4]));
        std::copy_n(row + 5, 3, samples.barycentrics.data() + 3 * i);
      }
    }
    return samples;
  }
};

SampleBuilder parse_xyzr(const IoSource& source) {
  TextCursor text(source);
  SampleBuilder builder;
  while (text.next_content()) {
    const char* const line = text.p;
    double row[4];
    const int found = text.numbers(row, 4);
    if (found < 4 || text.more_on_line()) {
      source.fail_line(line, "expected 4 numbers \"x y z r\", found " + (found < 4 ? std::to_string(found) : "more") +
                                 cut_short_or_not("a file of samples"));
    }
    if (const char* const what = SampleBuilder::trouble(row, 4)) source.fail_line(line, what);
    builder.values.insert(builder.values.end(), row, row + 4);
  }
  return builder;
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

SampleBuilder parse_csv_samples(const IoSource& source) {
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
  std::array<std::size_t, 8> field_of{};
  field_of.fill(missing);
  for (std::size_t i = 0; i < fields.size(); ++i) {
    for (std::size_t k = 0; k < field_of.size(); ++k) {
      const bool match = equal_ignoring_case(fields[i], kSampleColumns[k]) || (k == 3 && equal_ignoring_case(fields[i], "r"));
      if (match && field_of[k] == missing) field_of[k] = i;
    }
  }
  const auto has = [&](std::size_t from, std::size_t to) {
    return std::count(field_of.begin() + static_cast<std::ptrdiff_t>(from), field_of.begin() + static_cast<std::ptrdiff_t>(to),
                      missing) == 0;
  };
  if (!has(0, 4)) source.fail_line(fields[0].data(), "expected a header naming x, y, z and radius; add it");
  SampleBuilder builder;
  builder.columns = has(4, 8) ? 8 : 4;
  const std::size_t width = fields.size();
  while (next_fields()) {
    const char* const line = fields[0].data();
    if (fields.size() != width) {
      source.fail_line(line, "expected " + std::to_string(width) + " fields, found " + std::to_string(fields.size()) +
                                 cut_short_or_not("a CSV file of samples"));
    }
    double row[8];
    for (std::size_t k = 0; k < builder.columns; ++k) {
      const std::string_view field = fields[field_of[k]];
      if (!parse_double(field.data(), field.data() + field.size(), row[k])) {
        source.fail_line(line, "expected a number, found \"" + TextCursor::shown(field) + "\"; correct or remove the line");
      }
    }
    if (const char* const what = SampleBuilder::trouble(row, builder.columns)) source.fail_line(line, what);
    builder.values.insert(builder.values.end(), row, row + builder.columns);
  }
  return builder;
}

SampleBuilder parse_ply_samples(const IoSource& source) {
  const IoSource reading{source.data, source.name, source.run.part(0, 0.5)};
  PlyReader reader(reading);
  const PlyContent content = reader.read(kSampleColumns);
  const auto has = [&](std::size_t from, std::size_t to) {
    return std::count(content.found.begin() + static_cast<std::ptrdiff_t>(from),
                      content.found.begin() + static_cast<std::ptrdiff_t>(to), false) == 0;
  };
  if (!has(0, 4)) source.fail("its vertices have no x, y, z and radius; it is not a file of samples");
  SampleBuilder builder;
  builder.columns = has(4, 8) ? 8 : 4;
  builder.values.reserve(content.at.size() * builder.columns);
  Ticker ticker(source.run.part(0.5, 1), content.at.size(), kRowsPerLook);
  for (std::size_t i = 0; i < content.at.size(); ++i) {
    ticker.tick();
    const double* const row = content.values.data() + 8 * i;
    if (const char* const what = SampleBuilder::trouble(row, builder.columns)) reader.fail(content.at[i], what);
    builder.values.insert(builder.values.end(), row, row + builder.columns);
  }
  return builder;
}

// The set as rows of 4 or 8 values; throws if it is not one read_samples would accept.
SampleBuilder sample_rows(const SampleSet& samples, bool with_place, const Execution& run) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "samples: " + what); };
  const auto n = static_cast<std::size_t>(samples.positions.rows());
  const bool has_place = !samples.facets.empty();
  if (n == 0) fail("the set is empty; there is nothing to write");
  if (samples.radii.size() != n || (has_place && samples.facets.size() != n) ||
      static_cast<std::size_t>(samples.barycentrics.rows()) != (has_place ? n : 0)) {
    fail("positions, radii, facets and barycentrics differ in length; give one of each per sample");
  }
  SampleBuilder rows;
  rows.columns = with_place && has_place ? 8 : 4;
  rows.values.reserve(n * rows.columns);
  Ticker ticker(run, n, kRowsPerLook);
  for (std::size_t i = 0; i < n; ++i) {
    ticker.tick();
    const auto r = static_cast<std::ptrdiff_t>(i);
    double row[8] = {samples.positions(r, 0), samples.positions(r, 1), samples.positions(r, 2), samples.radii[i]};
    if (rows.columns == 8) {
      row[4] = samples.facets[i];
      for (int k = 0; k < 3; ++k) row[5 + k] = samples.barycentrics(r, k);
    }
    if (const char* const what = SampleBuilder::trouble(row, rows.columns)) fail("sample " + std::to_string(i) + ": " + what);
    rows.values.insert(rows.values.end(), row, row + rows.columns);
  }
  return rows;
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
  const detail::IoSource source{data, name, run.part(0, 0.8)};
  const detail::SampleBuilder rows = format == SampleFormat::kPly   ? detail::parse_ply_samples(source)
                                     : format == SampleFormat::kCsv ? detail::parse_csv_samples(source)
                                                                    : detail::parse_xyzr(source);
  SampleSet samples = rows.finish(source, run.part(0.8, 1));
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

std::string format_samples(const SampleSet& samples, SampleFormat format, const Execution& execution) {
  const Execution run = execution.start("writing");
  const detail::SampleBuilder rows = detail::sample_rows(samples, format != SampleFormat::kXyzr, run.part(0, 0.2));
  const std::size_t columns = rows.columns;
  std::string out;
  if (format == SampleFormat::kPly) {
    out = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(samples.positions.rows()) + '\n';
    for (std::size_t k = 0; k < columns; ++k)
      out += (k == 4 ? "property int " : "property double ") + detail::kSampleColumns[k] + '\n';
    out += "end_header\n";
  } else if (format == SampleFormat::kCsv) {
    for (std::size_t k = 0; k < columns; ++k) out += detail::kSampleColumns[k] + (k + 1 < columns ? ',' : '\n');
  }
  // A number and its comma, or a double, take some 20 bytes at most.
  out.reserve(out.size() + (format == SampleFormat::kPly ? 8u : 20u) * rows.values.size());
  detail::Ticker ticker(run.part(0.2, 1), rows.values.size(), detail::kRowsPerLook);
  for (std::size_t i = 0; i < rows.values.size(); ++i) {
    ticker.tick();
    const std::size_t column = i % columns;
    const double value = rows.values[i];
    if (format == SampleFormat::kPly) {
      if (column == 4) {
        detail::append_little_endian<std::uint32_t>(out, static_cast<Index>(value));
      } else {
        detail::append_little_endian<std::uint64_t>(out, value);
      }
      continue;
    }
    if (column == 4) {
      detail::append_number(out, static_cast<std::int64_t>(value));
    } else {
      detail::append_number(out, value);
    }
    if (column + 1 == columns) {
      out += '\n';
    } else {
      out += format == SampleFormat::kCsv ? ',' : ' ';
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
  detail::PlyContent content = reader.read({property});
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
