// ply.h (internal): reading PLY files, and what readers of all formats build meshes with.
#pragma once

#include "amps/file_io.h"
#include "amps/mesh.h"
#include "amps/polygons.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace amps::detail {

// Collects what a reader finds. Indices are checked by the reader, who knows where they stand.
class MeshBuilder {
 public:
  explicit MeshBuilder(const IoSource& source) : source_(source) {}

  void add_vertex(double x, double y, double z) { coordinates_.insert(coordinates_.end(), {x, y, z}); }
  void add_vertex(const double* xyz) { add_vertex(xyz[0], xyz[1], xyz[2]); }
  std::int64_t num_vertices() const { return static_cast<std::int64_t>(coordinates_.size() / 3); }

  // Polygons of more than three corners are cut at the end: vertices may come behind them.
  void add_polygon(const std::vector<Index>& corners) {
    if (corners.size() != 3) {
      others_.push_back({num_faces_, indices_.size() / 3, corners_.size(), corners.size()});
      corners_.insert(corners_.end(), corners.begin(), corners.end());
    } else {
      indices_.insert(indices_.end(), corners.begin(), corners.end());
    }
    ++num_faces_;
  }

  /// Instead of add_vertex().
  void set_coordinates(std::vector<double> coordinates) { coordinates_ = std::move(coordinates); }

  /// As if what the others hold had been added here, one after the other. Leaves them empty.
  void append_all(std::vector<MeshBuilder>& others) {
    std::size_t coordinates = coordinates_.size(), indices = indices_.size();
    for (const MeshBuilder& other : others) {
      coordinates += other.coordinates_.size();
      indices += other.indices_.size();
    }
    coordinates_.reserve(coordinates);
    indices_.reserve(indices);
    for (MeshBuilder& added : others) {
      source_.run.check();
      const MeshBuilder other = std::move(added);  // its memory goes when it is done
      for (const Other& face : other.others_) {
        others_.push_back({num_faces_ + face.face, indices_.size() / 3 + face.triangles_before,
                           corners_.size() + face.first_corner, face.size});
      }
      coordinates_.insert(coordinates_.end(), other.coordinates_.begin(), other.coordinates_.end());
      indices_.insert(indices_.end(), other.indices_.begin(), other.indices_.end());
      corners_.insert(corners_.end(), other.corners_.begin(), other.corners_.end());
      num_faces_ += other.num_faces_;
    }
  }

  /// Leaves the builder empty.
  Mesh finish() {
    constexpr std::size_t limit = static_cast<std::size_t>(std::numeric_limits<Index>::max());
    std::size_t num_triangles = indices_.size() / 3;
    for (const Other& other : others_) num_triangles += std::max(other.size, std::size_t{2}) - 2;
    if (coordinates_.size() / 3 > limit || num_triangles > limit || num_faces_ > limit) {
      source_.fail("more than 2^31 - 1 vertices or facets; cut it into parts", ErrorCode::kTooLarge);
    }
    Mesh mesh;
    if (!others_.empty()) cut_polygons(num_triangles, mesh);
    mesh.vertices = Points(std::move(coordinates_));
    mesh.triangles = Triangles(std::move(indices_));
    return mesh;
  }

  void reserve(std::size_t vertices, std::size_t facets) {
    coordinates_.reserve(3 * vertices);
    indices_.reserve(3 * facets);
  }

 private:
  // A face of other than three corners.
  struct Other {
    std::size_t face;
    std::size_t triangles_before;  // faces of three corners
    std::size_t first_corner, size;
  };

  void cut_polygons(std::size_t num_triangles, Mesh& mesh) {
    std::vector<Index> all;
    all.reserve(3 * num_triangles);
    mesh.polygons.reserve(num_triangles);
    PolygonCutter cutter(coordinates_.data(), source_.run);
    std::size_t copied = 0, face = 0;  // triangles; faces
    const auto copy_until = [&](std::size_t triangle) {
      all.insert(all.end(), indices_.begin() + static_cast<std::ptrdiff_t>(3 * copied),
                 indices_.begin() + static_cast<std::ptrdiff_t>(3 * triangle));
      for (; copied < triangle; ++copied) mesh.polygons.push_back(static_cast<Index>(face++));
    };
    for (const Other& other : others_) {
      source_.run.check();
      copy_until(other.triangles_before);
      face = other.face + 1;
      if (other.size < 3) continue;
      if (!cutter.cut(corners_.data() + other.first_corner, other.size, all)) {
        mesh.crossing_polygons.push_back(static_cast<Index>(other.face));
      }
      mesh.polygons.resize(all.size() / 3, static_cast<Index>(other.face));
    }
    copy_until(indices_.size() / 3);
    indices_ = std::move(all);
  }

  const IoSource& source_;
  std::vector<double> coordinates_;
  std::vector<Index> indices_;  // of faces of three corners, until finish()
  std::vector<Other> others_;
  std::vector<Index> corners_;  // of the others
  std::size_t num_faces_ = 0;
};

inline bool all_finite(const double* xyz) { return std::isfinite(xyz[0]) && std::isfinite(xyz[1]) && std::isfinite(xyz[2]); }

inline constexpr const char* kNotFinite = "a coordinate is NaN or infinite; correct or remove the vertex";

// Three finite coordinates from a line of text.
inline void read_coordinates(TextCursor& text, const char* line, double* xyz, const char* format) {
  const int found = text.numbers(xyz, 3);
  if (found < 3) {
    text.source.fail_line(line, "expected 3 coordinates, found " + std::to_string(found) + cut_short_or_not(format));
  }
  if (!all_finite(xyz)) text.source.fail_line(line, kNotFinite);
}

[[noreturn]] inline void fail_index(const IoSource& source, const char* where, std::int64_t index, std::int64_t count, int base,
                                    bool binary = false, const char* element = "face") {
  const std::string range = count == 0
                                ? "there is no vertex"
                                : "vertices are numbered " + std::to_string(base) + " to " + std::to_string(count - 1 + base);
  const std::string what =
      "vertex index " + std::to_string(index) + " is out of range, " + range + "; correct or remove the " + element;
  if (binary) source.fail_byte(where, what);
  source.fail_line(where, what);
}

// PLY

enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

inline std::ptrdiff_t ply_size(PlyType type) {
  constexpr std::array<std::ptrdiff_t, 8> sizes = {1, 1, 2, 2, 4, 4, 4, 8};
  return sizes[static_cast<std::size_t>(type)];
}

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat;
  PlyType count_type = PlyType::kUint8;
  bool is_list = false;
};

struct PlyElement {
  std::string name;
  std::int64_t count = 0;
  std::vector<PlyProperty> properties;
};

struct PlyHeader {
  bool ascii = false;
  bool big_endian = false;
  std::vector<PlyElement> elements;
};

// What a caller gets of a PLY file: the wanted scalar properties of the vertices. Faces go to a MeshBuilder.
struct PlyContent {
  std::vector<bool> found;      // per wanted property
  std::vector<double> values;   // vertex by vertex, wanted.size() each
  std::vector<const char*> at;  // where each vertex stands, for errors
  std::int64_t num_vertices = 0;
};

class PlyReader {
 public:
  explicit PlyReader(const IoSource& source) : source_(source), text_(source) { text_.comment = '\0'; }

  PlyContent read(const std::vector<std::string>& wanted, MeshBuilder& builder) {
    read_header();
    PlyContent content;
    content.found.assign(wanted.size(), false);
    int vertex_elements = 0;
    for (const PlyElement& element : header_.elements) {
      if (element.name != "vertex") continue;
      ++vertex_elements;
      content.num_vertices = element.count;
    }
    if (vertex_elements != 1) source_.fail("its header does not name one element vertex; it is not a PLY file amps can read");
    if (read_in_pieces(wanted, content, builder)) return content;
    for (const PlyElement& element : header_.elements) {
      require_room(element);
      if (element.name == "vertex") {
        read_vertices(element, wanted, content);
      } else if (element.name == "face" || element.name == "tristrips") {
        read_faces(element, content.num_vertices, builder);
      } else {
        for (std::int64_t i = 0; i < element.count && !element.properties.empty(); ++i) {
          source_.look(text_.p);
          for (const PlyProperty& property : element.properties) skip(property);
        }
      }
    }
    return content;
  }

  [[noreturn]] void fail(const char* where, const std::string& what) const {
    if (header_.ascii) source_.fail_line(where, what);
    source_.fail_byte(where, what);
  }

 private:
  // The next header line as its words; moves behind the end of the line.
  std::vector<std::string_view> header_line() {
    std::vector<std::string_view> words;
    line_ = text_.p;
    if (text_.at_end()) source_.fail_line(line_, "the header has no end_header" + cut_short_or_not("a PLY file"));
    while (text_.more_on_line()) words.push_back(text_.token());
    // A binary body may start with a byte that looks like an end of line, so \r\n is taken for one only if line 1 ended so.
    const bool crlf = !text_.at_end() && *text_.p == '\r' && text_.p + 1 < source_.end() && text_.p[1] == '\n';
    text_.skip_line();
    if (crlf && (crlf_ || line_ == source_.begin())) {
      crlf_ = true;
      ++text_.p;
    }
    return words;
  }

  [[noreturn]] void fail_header(const std::string& what) const {
    source_.fail_line(line_, what + "; it is not a PLY file amps can read");
  }

  PlyType type_named(std::string_view name) const {
    // In the order of PlyType, by the old and the new name.
    static constexpr std::array<std::array<std::string_view, 2>, 8> names = {{{"char", "int8"},
                                                                              {"uchar", "uint8"},
                                                                              {"short", "int16"},
                                                                              {"ushort", "uint16"},
                                                                              {"int", "int32"},
                                                                              {"uint", "uint32"},
                                                                              {"float", "float32"},
                                                                              {"double", "float64"}}};
    for (std::size_t k = 0; k < names.size(); ++k) {
      if (name == names[k][0] || name == names[k][1]) return static_cast<PlyType>(k);
    }
    fail_header("unknown type \"" + TextCursor::shown(name) + "\"");
  }

  void read_header() {
    if (source_.data.empty()) source_.fail("it is empty; a PLY file starts with the word ply");
    std::vector<std::string_view> words = header_line();
    if (words.size() != 1 || words[0] != "ply") fail_header("expected ply");
    bool has_format = false, after_comment = false;
    for (;;) {
      words = header_line();
      const bool comment = !words.empty() && (words[0] == "comment" || words[0] == "obj_info");
      if (words.empty() || comment) {
        after_comment = comment || after_comment;
        continue;
      }
      // Old exporters wrote file names with line ends in them: what follows a comment and is no word of PLY belongs to it.
      const bool known = words[0] == "end_header" || words[0] == "format" || words[0] == "element" || words[0] == "property";
      if (!known && after_comment) continue;
      after_comment = false;
      if (words[0] == "end_header") break;
      if (words[0] == "format" && words.size() >= 2) {
        header_.ascii = words[1] == "ascii";
        header_.big_endian = words[1] == "binary_big_endian";
        has_format = header_.ascii || header_.big_endian || words[1] == "binary_little_endian";
      } else if (words[0] == "element" && words.size() == 3) {
        PlyElement element;
        element.name = words[1];
        const char* p = words[2].data();
        const char* const end = p + words[2].size();
        if (!parse_integer(p, end, element.count) || p != end || element.count < 0) {
          fail_header("the number of elements is \"" + TextCursor::shown(words[2]) + "\"");
        }
        header_.elements.push_back(std::move(element));
      } else if (words[0] == "property" && !header_.elements.empty() && (words.size() == 3 || words.size() == 5)) {
        PlyProperty property;
        property.is_list = words[1] == "list";
        if (property.is_list != (words.size() == 5)) fail_header("a property that is neither a scalar nor a list");
        if (property.is_list) property.count_type = type_named(words[2]);
        property.type = type_named(words[words.size() - 2]);
        property.name = words.back();
        header_.elements.back().properties.push_back(std::move(property));
      } else {
        fail_header("cannot make sense of \"" + TextCursor::shown(words[0]) + "\"");
      }
    }
    if (!has_format) fail_header("no format ascii, binary_little_endian or binary_big_endian");
  }

  // Vertices and then faces in text, a line each, on all threads. False, and nothing read, if it is other, or if anything is
  // wrong. Values may be on any lines: but where each piece has the values of as many rows as it has lines, no more and no
  // less, the rows are the same.
  bool read_in_pieces(const std::vector<std::string>& wanted, PlyContent& content, MeshBuilder& builder) {
    if (!header_.ascii || !worth_pieces(source_, text_.p) || header_.elements.size() != 2) return false;
    const PlyElement &vertices = header_.elements[0], &faces = header_.elements[1];
    if (vertices.name != "vertex" || faces.name != "face" || vertices.properties.empty() || faces.properties.empty())
      return false;
    require_room(vertices);
    const std::int64_t left = source_.end() - text_.p;
    if (faces.count > left) return false;
    const RowPieces cut(source_, text_.p, vertices.count + faces.count);
    if (!cut.complete()) return false;
    std::vector<MeshBuilder> builders(cut.pieces.size(), MeshBuilder(source_));
    std::vector<PlyContent> contents(cut.pieces.size());
    const bool complete = parse_pieces(source_, cut.pieces, [&](std::size_t k, const IoSource& piece) {
      PlyReader reader(piece);
      reader.header_.ascii = true;
      PlyElement some_vertices = vertices, some_faces = faces;
      const std::int64_t begin = std::min(cut.first_row(k), vertices.count);
      some_vertices.count = std::min(cut.first_row(k + 1), vertices.count) - begin;
      some_faces.count = cut.first_row(k + 1) - cut.first_row(k) - some_vertices.count;
      contents[k].found.assign(wanted.size(), false);
      reader.read_vertices(some_vertices, wanted, contents[k]);
      reader.read_faces(some_faces, vertices.count, builders[k]);
      if (cut.first_row(k + 1) < cut.rows && reader.text_.next_content()) throw NotByItself();
    });
    if (!complete) return false;
    content.found = contents[0].found;
    content.values.reserve(static_cast<std::size_t>(vertices.count) * wanted.size());
    content.at.reserve(static_cast<std::size_t>(vertices.count));
    for (const PlyContent& some : contents) {
      source_.run.check();
      content.values.insert(content.values.end(), some.values.begin(), some.values.end());
      content.at.insert(content.at.end(), some.at.begin(), some.at.end());
    }
    builder.append_all(builders);
    return true;
  }

  // Refuses counts the rest of the file cannot hold. In text every value takes two bytes, but for the last.
  void require_room(const PlyElement& element) const {
    std::int64_t min_bytes = 0;
    for (const PlyProperty& property : element.properties) {
      min_bytes += header_.ascii ? 2 : ply_size(property.is_list ? property.count_type : property.type);
    }
    const std::int64_t left = source_.end() - text_.p + (header_.ascii ? 1 : 0);
    if (min_bytes > 0 && element.count > left / min_bytes) {
      source_.fail("its header promises " + std::to_string(element.count) + " elements " + TextCursor::shown(element.name) +
                   ", more than the " + std::to_string(left) +
                   " bytes left can hold; the file is cut short or its header is wrong");
    }
    if (element.name == "vertex" && element.count > std::numeric_limits<Index>::max()) {
      source_.fail("more than 2^31 - 1 vertices; cut it into parts", ErrorCode::kTooLarge);
    }
  }

  void need(std::int64_t bytes) const {
    if (source_.end() - text_.p < bytes) fail(text_.p, "the file ends inside its data; it is cut short");
  }

  std::string_view ascii_token() {
    if (!text_.next_content()) fail(text_.p, "the file ends inside its data; it is cut short");
    return text_.token();
  }

  double scalar(PlyType type) {
    if (header_.ascii) {
      const std::string_view token = ascii_token();
      double value = 0;
      if (!parse_double(token.data(), token.data() + token.size(), value)) {
        fail(token.data(), "expected a number, found \"" + TextCursor::shown(token) + "\"; correct it");
      }
      return value;
    }
    const std::ptrdiff_t size = ply_size(type);
    need(size);
    const char* const p = text_.p;
    text_.p += size;
    const bool big = header_.big_endian;
    switch (type) {
      case PlyType::kInt8:
        return load_as<std::int8_t, std::uint8_t>(p, big);
      case PlyType::kUint8:
        return load_bytes<std::uint8_t>(p, big);
      case PlyType::kInt16:
        return load_as<std::int16_t, std::uint16_t>(p, big);
      case PlyType::kUint16:
        return load_bytes<std::uint16_t>(p, big);
      case PlyType::kInt32:
        return load_as<std::int32_t, std::uint32_t>(p, big);
      case PlyType::kUint32:
        return load_bytes<std::uint32_t>(p, big);
      case PlyType::kFloat:
        return static_cast<double>(load_as<float, std::uint32_t>(p, big));
      case PlyType::kDouble:
        break;
    }
    return load_as<double, std::uint64_t>(p, big);
  }

  // A whole number that is a count or an index, exactly; −1 for anything else.
  static std::int64_t as_count(double value) {
    return value >= 0 && value <= 4294967295.0 && value == std::floor(value) ? static_cast<std::int64_t>(value) : -1;
  }

  std::int64_t list_size(const PlyProperty& property) {
    const char* const at = text_.p;
    const std::int64_t size = as_count(scalar(property.count_type));
    if (size < 0) fail(at, "the length of a list is not a whole number ≥ 0; the file is damaged");
    if (!header_.ascii) need(size * ply_size(property.type));
    return size;
  }

  // Skipped values are not looked at: ascii files hold "nan" and the like in them.
  void skip(const PlyProperty& property) {
    const std::int64_t count = property.is_list ? list_size(property) : 1;
    if (header_.ascii) {
      for (std::int64_t k = 0; k < count; ++k) ascii_token();
    } else {
      need(count * ply_size(property.type));
      text_.p += count * ply_size(property.type);
    }
  }

  void read_vertices(const PlyElement& element, const std::vector<std::string>& wanted, PlyContent& content) {
    // For each property its column, or wanted.size() for those to skip.
    std::vector<std::size_t> columns;
    for (const PlyProperty& property : element.properties) {
      const auto match = std::find(wanted.begin(), wanted.end(), property.name);
      const auto column = static_cast<std::size_t>(match - wanted.begin());
      columns.push_back(property.is_list ? wanted.size() : column);
      if (columns.back() < wanted.size()) content.found[column] = true;
    }
    if (element.properties.empty()) return;
    content.values.assign(static_cast<std::size_t>(element.count) * wanted.size(), 0.0);
    content.at.reserve(static_cast<std::size_t>(element.count));
    for (std::size_t i = 0; i < static_cast<std::size_t>(element.count); ++i) {
      source_.look(text_.p);
      if (header_.ascii && !text_.next_content()) ascii_token();
      content.at.push_back(text_.p);
      for (std::size_t k = 0; k < columns.size(); ++k) {
        if (columns[k] < wanted.size()) {
          content.values[i * wanted.size() + columns[k]] = scalar(element.properties[k].type);
        } else {
          skip(element.properties[k]);
        }
      }
    }
  }

  void read_faces(const PlyElement& element, std::int64_t num_vertices, MeshBuilder& builder) {
    const auto is_corners = [](const PlyProperty& p) {
      return p.is_list && (p.name == "vertex_indices" || p.name == "vertex_index");
    };
    const bool strips = element.name == "tristrips";
    if (element.count > 0 && std::none_of(element.properties.begin(), element.properties.end(), is_corners)) {
      source_.fail("its faces have no list vertex_indices; it is not a PLY mesh");
    }
    builder.reserve(0, static_cast<std::size_t>(element.count));
    std::vector<Index> corners;
    for (std::int64_t i = 0; i < element.count; ++i) {
      source_.look(text_.p);
      for (const PlyProperty& property : element.properties) {
        if (!is_corners(property)) {
          skip(property);
          continue;
        }
        if (header_.ascii) text_.next_content();
        const char* const at = text_.p;
        const std::int64_t size = list_size(property);
        corners.clear();
        for (std::int64_t k = 0; k < size; ++k) {
          const double value = scalar(property.type);
          const std::int64_t index = as_count(value);
          if (strips && value == -1) {  // the end of a strip
            add_strip(corners, builder);
            corners.clear();
            continue;
          }
          if (index < 0 && value != std::floor(value)) fail(at, "a vertex index is not a whole number; correct the face");
          if (index < 0 || index >= num_vertices) {
            const std::int64_t shown = index < 0 ? static_cast<std::int64_t>(std::clamp(value, -4e9, 8e9)) : index;
            fail_index(source_, at, shown, num_vertices, 0, !header_.ascii);
          }
          corners.push_back(static_cast<Index>(index));
        }
        strips ? add_strip(corners, builder) : builder.add_polygon(corners);
      }
    }
  }

  // Each corner makes a triangle with the two before it; every second turns the other way. Triangles of repeated corners only
  // join parts of a strip.
  static void add_strip(const std::vector<Index>& corners, MeshBuilder& builder) {
    for (std::size_t k = 2; k < corners.size(); ++k) {
      const Index a = corners[k - 2 + k % 2], b = corners[k - 1 - k % 2], c = corners[k];
      if (a != b && b != c && c != a) builder.add_polygon({a, b, c});
    }
  }

  const IoSource& source_;
  TextCursor text_;
  PlyHeader header_;
  const char* line_ = nullptr;
  bool crlf_ = false;
};

}  // namespace amps::detail
