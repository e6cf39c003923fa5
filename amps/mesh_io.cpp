#define AMPS_OWN_SOURCE
#include "amps/mesh_io.h"

#include "amps/file_io.h"

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

// ---- Growing meshes ----

// Collects what a reader finds. Indices are checked by the reader, who knows where they stand.
class MeshBuilder {
 public:
  explicit MeshBuilder(const IoSource& source) : source_(source) {}

  void add_vertex(double x, double y, double z) { coordinates_.insert(coordinates_.end(), {x, y, z}); }
  void add_vertex(const double* xyz) { add_vertex(xyz[0], xyz[1], xyz[2]); }
  std::int64_t num_vertices() const { return static_cast<std::int64_t>(coordinates_.size() / 3); }

  // A polygon as a fan from its first corner.
  void add_polygon(const std::vector<Index>& corners) {
    for (std::size_t k = 2; k < corners.size(); ++k) {
      indices_.insert(indices_.end(), {corners[0], corners[k - 1], corners[k]});
    }
  }

  Mesh finish() const {
    constexpr std::size_t limit = static_cast<std::size_t>(std::numeric_limits<Index>::max());
    if (coordinates_.size() / 3 > limit || indices_.size() / 3 > limit) {
      source_.fail("more than 2^31 - 1 vertices or facets; cut it into parts", ErrorCode::kTooLarge);
    }
    Mesh mesh;
    mesh.vertices = Eigen::Map<const Points>(coordinates_.data(), static_cast<Eigen::Index>(coordinates_.size() / 3), 3);
    mesh.triangles = Eigen::Map<const Triangles>(indices_.data(), static_cast<Eigen::Index>(indices_.size() / 3), 3);
    return mesh;
  }

  void reserve(std::size_t vertices, std::size_t facets) {
    coordinates_.reserve(3 * vertices);
    indices_.reserve(3 * facets);
  }

 private:
  const IoSource& source_;
  std::vector<double> coordinates_;
  std::vector<Index> indices_;
};

bool all_finite(const double* xyz) { return std::isfinite(xyz[0]) && std::isfinite(xyz[1]) && std::isfinite(xyz[2]); }

constexpr const char* kNotFinite = "a coordinate is NaN or infinite; correct or remove the vertex";

// Three finite coordinates from a line of text.
void read_coordinates(TextCursor& text, const char* line, double* xyz, const char* format) {
  const int found = text.numbers(xyz, 3);
  if (found < 3) {
    text.source.fail_line(line, "expected 3 coordinates, found " + std::to_string(found) + cut_short_or_not(format));
  }
  if (!all_finite(xyz)) text.source.fail_line(line, kNotFinite);
}

[[noreturn]] void fail_index(const IoSource& source, const char* where, std::int64_t index, std::int64_t count, int base,
                             bool binary = false) {
  const std::string range = count == 0
                                ? "there is no vertex"
                                : "vertices are numbered " + std::to_string(base) + " to " + std::to_string(count - 1 + base);
  const std::string what =
      "vertex index " + std::to_string(index) + " is out of range, " + range + "; correct or remove the face";
  if (binary) source.fail_byte(where, what);
  source.fail_line(where, what);
}

// ---- OBJ ----

// One face; corner texts are v, v/t, v//n or v/t/n, 1-based or, if negative, counted back from the last vertex so far.
void read_obj_face(TextCursor& text, std::int64_t num_vertices, std::vector<Index>& corners) {
  corners.clear();
  while (text.more_on_line()) {
    const std::string_view corner = text.token();
    const char* p = corner.data();
    const char* const end = p + corner.size();
    std::int64_t index = 0;
    if (!parse_integer(p, end, index) || (p < end && *p != '/')) {
      text.source.fail_line(corner.data(),
                            "expected a vertex index, found \"" + TextCursor::shown(corner) + "\"; correct or remove the face");
    }
    const std::int64_t zero_based = index < 0 ? num_vertices + index : index - 1;
    if (zero_based < 0 || zero_based >= std::numeric_limits<Index>::max()) {
      fail_index(text.source, corner.data(), index, num_vertices, 1);
    }
    corners.push_back(static_cast<Index>(zero_based));
  }
}

Mesh parse_obj(const IoSource& source) {
  MeshBuilder builder(source);
  TextCursor text(source);
  text.continuation = true;
  // Faces may come before their vertices, so the range is checked at the end, for the greatest index met.
  Index greatest = kNone;
  const char* greatest_face = nullptr;
  std::vector<Index> corners;
  while (text.next_content()) {
    const char* const line = text.p;
    const std::string_view keyword = text.token();
    if (keyword == "v") {
      double xyz[3];
      read_coordinates(text, line, xyz, "an OBJ file");  // a weight or colour behind them is skipped
      builder.add_vertex(xyz);
    } else if (keyword == "f") {
      read_obj_face(text, builder.num_vertices(), corners);
      for (const Index corner : corners) {
        if (corner <= greatest) continue;
        greatest = corner;
        greatest_face = line;
      }
      builder.add_polygon(corners);
    }
    text.skip_line();
  }
  if (builder.num_vertices() == 0) source.fail("no line \"v x y z\" in it; it is not an OBJ file");
  if (greatest >= builder.num_vertices()) {
    fail_index(source, greatest_face, std::int64_t{greatest} + 1, builder.num_vertices(), 1);
  }
  return builder.finish();
}

// ---- OFF ----

struct OffHeader {
  std::int64_t vertices = 0, faces = 0;
  int floats_per_vertex = 3;  // binary: normals, colours and texture coordinates behind the position
  bool binary = false;
};

// "[ST][C][N]OFF", "BINARY" perhaps, and for text the counts, on one line or more.
OffHeader read_off_header(TextCursor& text) {
  const IoSource& source = text.source;
  OffHeader header;
  if (!text.next_content()) source.fail("it is empty; an OFF file starts with the word OFF");
  const char* const start = text.p;
  const std::string_view word = text.token();
  std::string_view rest = word;
  const auto take = [&rest](std::string_view prefix) {
    const bool found = rest.substr(0, prefix.size()) == prefix;
    if (found) rest.remove_prefix(prefix.size());
    return found;
  };
  header.floats_per_vertex += take("ST") ? 2 : 0;
  header.floats_per_vertex += take("C") ? 4 : 0;
  header.floats_per_vertex += take("N") ? 3 : 0;
  if (rest == "4OFF" || rest == "nOFF" || rest == "4nOFF") {
    source.fail_line(start, "\"" + std::string(word) + "\" holds points of other than 3 dimensions; save it as OFF");
  }
  if (rest != "OFF") source.fail_line(start, "expected OFF, found \"" + TextCursor::shown(word) + "\"; it is not an OFF file");
  if (text.more_on_line()) {
    TextCursor ahead = text;
    header.binary = ahead.token() == "BINARY";
    if (header.binary) {
      text.p = ahead.p;
      text.skip_line();
      if (text.p[-1] == '\r' && !text.at_end() && *text.p == '\n') ++text.p;
      return header;
    }
  }
  std::int64_t* const counts[2] = {&header.vertices, &header.faces};
  for (std::int64_t* const count : counts) {
    const bool found = text.next_content();
    const std::string_view number = found ? text.token() : std::string_view();
    const char* p = number.data();
    if (!found || !parse_integer(p, p + number.size(), *count) || p != number.data() + number.size()) {
      source.fail_line(text.p, "expected the numbers of vertices and faces" + cut_short_or_not("an OFF file"));
    }
  }
  // Behind them stands the number of edges, which nobody uses; what is left of the line goes with it.
  text.skip_line();
  return header;
}

// Every vertex takes at least `vertex_bytes`, every face `face_bytes`; checked before anything is allocated.
void require_plausible(const IoSource& source, std::int64_t vertices, std::int64_t faces, std::int64_t vertex_bytes,
                       std::int64_t face_bytes, std::int64_t bytes_left) {
  if (vertices < 0 || faces < 0 || vertices > bytes_left / vertex_bytes || faces > bytes_left / face_bytes) {
    source.fail("its header promises " + std::to_string(vertices) + " vertices and " + std::to_string(faces) +
                " faces, more than " + std::to_string(source.data.size()) +
                " bytes can hold; the file is cut short or its header is wrong");
  }
}

Mesh parse_binary_off(TextCursor& text, const OffHeader& header) {
  const IoSource& source = text.source;
  const char* p = text.p;
  const auto need = [&](std::int64_t bytes, const char* what) {
    if (source.end() - p < bytes) source.fail_byte(p, std::string("the file ends inside ") + what + "; it is cut short");
  };
  const auto next_int = [&p] {
    p += 4;
    return std::int64_t{load_as<std::int32_t, std::uint32_t>(p - 4, true)};
  };
  need(12, "the counts");
  const std::int64_t vertices = next_int(), faces = next_int();
  next_int();  // edges
  const std::int64_t stride = 4 * header.floats_per_vertex;
  require_plausible(source, vertices, faces, stride, 8, source.end() - p);
  MeshBuilder builder(source);
  builder.reserve(static_cast<std::size_t>(vertices), static_cast<std::size_t>(faces));
  for (std::int64_t v = 0; v < vertices; ++v, p += stride) {
    need(stride, "the vertices");
    double xyz[3];
    for (int k = 0; k < 3; ++k) xyz[k] = static_cast<double>(load_as<float, std::uint32_t>(p + 4 * k, true));
    if (!all_finite(xyz)) source.fail_byte(p, kNotFinite);
    builder.add_vertex(xyz);
  }
  std::vector<Index> corners;
  for (std::int64_t f = 0; f < faces; ++f) {
    need(4, "the faces");
    const std::int64_t size = next_int();
    if (size < 0) source.fail_byte(p - 4, "a face of " + std::to_string(size) + " corners; it is not a binary OFF file");
    need(4 * size + 4, "the faces");
    corners.clear();
    for (std::int64_t k = 0; k < size; ++k) {
      const std::int64_t index = next_int();
      if (index < 0 || index >= vertices) fail_index(source, p - 4, index, vertices, 0, true);
      corners.push_back(static_cast<Index>(index));
    }
    const std::int64_t colors = next_int();
    if (colors < 0) source.fail_byte(p - 4, "a colour of " + std::to_string(colors) + " parts; it is not a binary OFF file");
    need(4 * colors, "the faces");
    p += 4 * colors;
    builder.add_polygon(corners);
  }
  return builder.finish();
}

Mesh parse_off(const IoSource& source) {
  TextCursor text(source);
  const OffHeader header = read_off_header(text);
  if (header.binary) return parse_binary_off(text, header);
  require_plausible(source, header.vertices, header.faces, 6, 2, source.end() - text.p + 1);
  MeshBuilder builder(source);
  builder.reserve(static_cast<std::size_t>(header.vertices), static_cast<std::size_t>(header.faces));
  const auto next_line = [&](const char* what, std::int64_t done, std::int64_t wanted) {
    if (text.next_content()) return text.p;
    source.fail("its header promises " + std::to_string(wanted) + " " + what + ", but it ends after " + std::to_string(done) +
                "; the file is cut short");
  };
  for (std::int64_t v = 0; v < header.vertices; ++v) {
    const char* const line = next_line("vertices", v, header.vertices);
    double xyz[3];
    read_coordinates(text, line, xyz, "an OFF file");  // normals, colours, texture coordinates behind them are skipped
    builder.add_vertex(xyz);
    text.skip_line();
  }
  std::vector<Index> corners;
  for (std::int64_t f = 0; f < header.faces; ++f) {
    const char* const line = next_line("faces", f, header.faces);
    const auto next_integer = [&](std::int64_t& value) {
      const std::string_view number = text.token();
      const char* p = number.data();
      if (!parse_integer(p, p + number.size(), value) || p != number.data() + number.size()) {
        source.fail_line(line,
                         "expected a whole number, found \"" + TextCursor::shown(number) + "\"; correct or remove the face");
      }
    };
    std::int64_t size = 0;
    next_integer(size);
    if (size < 0) source.fail_line(line, "a face of " + std::to_string(size) + " corners; it is not an OFF file");
    corners.clear();
    for (std::int64_t k = 0; k < size; ++k) {
      if (!text.more_on_line()) {
        source.fail_line(line, "expected " + std::to_string(size) + " vertex indices, found " + std::to_string(k) +
                                   cut_short_or_not("an OFF file"));
      }
      std::int64_t index = 0;
      next_integer(index);
      if (index < 0 || index >= header.vertices) fail_index(source, line, index, header.vertices, 0);
      corners.push_back(static_cast<Index>(index));
    }
    builder.add_polygon(corners);
    text.skip_line();  // a colour may follow
  }
  return builder.finish();
}

// ---- PLY ----

enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

std::ptrdiff_t ply_size(PlyType type) {
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

// What a caller gets of a PLY file: the wanted scalar properties of the vertices, and the faces as triangles.
struct PlyContent {
  std::vector<bool> found;      // per wanted property
  std::vector<double> values;   // vertex by vertex, wanted.size() each
  std::vector<const char*> at;  // where each vertex stands, for errors
  Mesh faces;                   // triangles only
  std::int64_t num_vertices = 0;
};

class PlyReader {
 public:
  explicit PlyReader(const IoSource& source) : source_(source), text_(source) { text_.comment = '\0'; }

  PlyContent read(const std::vector<std::string>& wanted) {
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
    MeshBuilder builder(source_);
    for (const PlyElement& element : header_.elements) {
      require_room(element);
      if (element.name == "vertex") {
        read_vertices(element, wanted, content);
      } else if (element.name == "face") {
        read_faces(element, content.num_vertices, builder);
      } else {
        for (std::int64_t i = 0; i < element.count && !element.properties.empty(); ++i) {
          for (const PlyProperty& property : element.properties) skip(property);
        }
      }
    }
    content.faces = builder.finish();
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
    bool has_format = false;
    for (;;) {
      words = header_line();
      if (words.empty() || words[0] == "comment" || words[0] == "obj_info") continue;
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

  // Refuses counts the rest of the file cannot hold. In text every value takes two bytes, but for the last.
  void require_room(const PlyElement& element) const {
    std::int64_t least = 0;
    for (const PlyProperty& property : element.properties) {
      least += header_.ascii ? 2 : ply_size(property.is_list ? property.count_type : property.type);
    }
    const std::int64_t left = source_.end() - text_.p + (header_.ascii ? 1 : 0);
    if (least > 0 && element.count > left / least) {
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
    if (element.count > 0 && std::none_of(element.properties.begin(), element.properties.end(), is_corners)) {
      source_.fail("its faces have no list vertex_indices; it is not a PLY mesh");
    }
    builder.reserve(0, static_cast<std::size_t>(element.count));
    std::vector<Index> corners;
    for (std::int64_t i = 0; i < element.count; ++i) {
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
          if (index < 0 && value != std::floor(value)) fail(at, "a vertex index is not a whole number; correct the face");
          if (index < 0 || index >= num_vertices) {
            const std::int64_t shown = index < 0 ? static_cast<std::int64_t>(std::clamp(value, -4e9, 8e9)) : index;
            fail_index(source_, at, shown, num_vertices, 0, !header_.ascii);
          }
          corners.push_back(static_cast<Index>(index));
        }
        builder.add_polygon(corners);
      }
    }
  }

  const IoSource& source_;
  TextCursor text_;
  PlyHeader header_;
  const char* line_ = nullptr;
  bool crlf_ = false;
};

Mesh parse_ply(const IoSource& source) {
  PlyReader reader(source);
  PlyContent content = reader.read({"x", "y", "z"});
  if (content.num_vertices > 0 && !(content.found[0] && content.found[1] && content.found[2])) {
    source.fail("its vertices have no x, y and z; it is not a PLY mesh");
  }
  Mesh mesh = std::move(content.faces);
  mesh.vertices = Eigen::Map<const Points>(content.values.data(), static_cast<Eigen::Index>(content.num_vertices), 3);
  for (std::size_t i = 0; i < content.at.size(); ++i) {
    if (!all_finite(content.values.data() + 3 * i)) reader.fail(content.at[i], kNotFinite);
  }
  return mesh;
}

// ---- STL ----

Mesh parse_ascii_stl(const IoSource& source) {
  MeshBuilder builder(source);
  TextCursor text(source);
  text.comment = '\0';
  std::vector<Index> corners;
  bool complete = false;
  while (text.next_content()) {
    const char* const line = text.p;
    const std::string_view word = text.token();
    const auto skip_tokens = [&text](int count) {
      for (; count > 0 && text.next_content(); --count) text.token();
    };
    if (equal_ignoring_case(word, "vertex")) {
      double xyz[3];
      read_coordinates(text, line, xyz, "an STL file");
      corners.push_back(static_cast<Index>(std::min<std::int64_t>(builder.num_vertices(), std::numeric_limits<Index>::max())));
      builder.add_vertex(xyz);
    } else if (equal_ignoring_case(word, "facet")) {
      skip_tokens(4);  // normal nx ny nz: derived data, and often wrong
    } else if (equal_ignoring_case(word, "outer")) {
      skip_tokens(1);
      corners.clear();
    } else if (equal_ignoring_case(word, "endloop")) {
      if (corners.size() != 3) {
        source.fail_line(line,
                         "expected 3 vertices in the loop, found " + std::to_string(corners.size()) + "; correct the facet");
      }
      builder.add_polygon(corners);
      corners.clear();
    } else if (equal_ignoring_case(word, "solid") || equal_ignoring_case(word, "endsolid")) {
      complete = word.size() > 5;
      text.skip_line();  // the rest is its name
    } else if (!equal_ignoring_case(word, "endfacet")) {
      source.fail_line(line, "expected facet or vertex, found \"" + TextCursor::shown(word) + "\"; it is not an STL file");
    }
  }
  if (!complete || !corners.empty()) source.fail("it ends before endsolid; the file is cut short");
  return builder.finish();
}

Mesh parse_binary_stl(const IoSource& source, std::int64_t facets) {
  constexpr std::ptrdiff_t record = 50, normal = 12;  // a normal, three corners, two bytes of attributes
  MeshBuilder builder(source);
  builder.reserve(static_cast<std::size_t>(3 * facets), static_cast<std::size_t>(facets));
  const char* p = source.begin() + 84;
  for (std::int64_t f = 0; f < facets; ++f, p += record) {
    for (std::ptrdiff_t corner = 0; corner < 3; ++corner) {
      double xyz[3];
      for (std::ptrdiff_t k = 0; k < 3; ++k) {
        xyz[k] = static_cast<double>(load_as<float, std::uint32_t>(p + normal + 12 * corner + 4 * k, false));
      }
      if (!all_finite(xyz)) source.fail_byte(p + normal + 12 * corner, kNotFinite);
      builder.add_vertex(xyz);
    }
    const auto first = static_cast<Index>(3 * f);
    builder.add_polygon({first, first + 1, first + 2});
  }
  return builder.finish();
}

// Headers of binary files start with "solid" often enough that only the size tells: 84 bytes and 50 a facet.
Mesh parse_stl(const IoSource& source) {
  const auto size = static_cast<std::int64_t>(source.data.size());
  const std::int64_t facets = size < 84 ? -1 : load_bytes<std::uint32_t>(source.begin() + 80, false);
  constexpr std::int64_t most = std::numeric_limits<Index>::max() / 3;
  const bool exact_size = facets >= 0 && size == 84 + 50 * facets;
  TextCursor text(source);
  const bool says_solid = text.next_content() && equal_ignoring_case(text.token(), "solid");
  const bool has_zeros = source.data.substr(0, 512).find('\0') != std::string_view::npos;
  if (!exact_size && says_solid && !has_zeros) return merge_equal_vertices(parse_ascii_stl(source));
  if (facets < 0) source.fail("it neither starts with solid nor has the 84 bytes of a header; it is not an STL file");
  if (size < 84 + 50 * facets) {
    source.fail("its header promises " + std::to_string(facets) + " facets, more than " + std::to_string(size) +
                " bytes can hold; the file is cut short or is not an STL file");
  }
  if (facets == 0 && size > 84) source.fail("its header promises no facet, but data follows; it is not an STL file");
  if (facets > most) source.fail("more than 2^31 - 1 corners; cut it into parts", ErrorCode::kTooLarge);
  return merge_equal_vertices(parse_binary_stl(source, facets));
}

// ---- Writing meshes ----

void require_writable(const MeshView& mesh, MeshFormat format) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidMesh, "mesh: " + what); };
  const double most =
      format == MeshFormat::kStl ? static_cast<double>(std::numeric_limits<float>::max()) : std::numeric_limits<double>::max();
  for (Eigen::Index v = 0; v < mesh.vertices.rows(); ++v) {
    for (int k = 0; k < 3; ++k) {
      const double x = std::abs(mesh.vertices(v, k));
      if (x <= most) continue;  // false for NaN
      fail("vertex " + std::to_string(v) + " (0-based) has a coordinate that is " +
           (std::isfinite(x) ? "too large for STL; write PLY, OBJ or OFF" : "NaN or infinite; correct it before writing"));
    }
  }
  for (Eigen::Index f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      if (mesh.triangles(f, k) >= 0 && mesh.triangles(f, k) < mesh.vertices.rows()) continue;
      fail("facet " + std::to_string(f) + " (0-based) has a corner that is not a vertex; correct it before writing");
    }
  }
}

// "prefix a b c\n", with `offset` added to indices.
void append_row(std::string& out, const char* prefix, const double* row) {
  out += prefix;
  for (int k = 0; k < 3; ++k) {
    if (k > 0) out += ' ';
    append_number(out, row[k]);
  }
  out += '\n';
}
void append_row(std::string& out, const char* prefix, const Index* row, int offset) {
  out += prefix;
  for (int k = 0; k < 3; ++k) {
    if (k > 0) out += ' ';
    append_number(out, std::int64_t{row[k]} + offset);
  }
  out += '\n';
}

std::string format_stl(const MeshView& mesh) {
  std::string out = "binary STL by amps";  // must not start with "solid"
  out.resize(80, ' ');
  append_little_endian<std::uint32_t>(out, static_cast<std::uint32_t>(mesh.num_facets()));
  out.reserve(84 + 50 * static_cast<std::size_t>(mesh.num_facets()));
  const Points normals = facet_normals(mesh);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) append_float(out, normals(f, k));
    for (int corner = 0; corner < 3; ++corner) {
      for (int k = 0; k < 3; ++k) append_float(out, mesh.vertices(mesh.triangles(f, corner), k));
    }
    out.append(2, '\0');
  }
  return out;
}

std::string format_ply(const MeshView& mesh, bool ascii) {
  std::string out = "ply\nformat ";
  out += ascii ? "ascii" : "binary_little_endian";
  out += " 1.0\nelement vertex " + std::to_string(mesh.vertices.rows());
  out += "\nproperty double x\nproperty double y\nproperty double z\nelement face " + std::to_string(mesh.triangles.rows());
  out += "\nproperty list uchar int vertex_indices\nend_header\n";
  if (!ascii) out.reserve(out.size() + static_cast<std::size_t>(24 * mesh.vertices.rows() + 13 * mesh.triangles.rows()));
  for (Eigen::Index v = 0; v < mesh.vertices.rows(); ++v) {
    if (ascii) {
      append_row(out, "", mesh.vertices.row(v).data());
    } else {
      for (int k = 0; k < 3; ++k) append_little_endian<std::uint64_t>(out, mesh.vertices(v, k));
    }
  }
  for (Eigen::Index f = 0; f < mesh.triangles.rows(); ++f) {
    if (ascii) {
      append_row(out, "3 ", mesh.triangles.row(f).data(), 0);
    } else {
      out += '\3';
      for (int k = 0; k < 3; ++k) append_little_endian<std::uint32_t>(out, mesh.triangles(f, k));
    }
  }
  return out;
}

// ---- Samples ----

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

  SampleSet finish(const IoSource& source) const {
    const std::size_t n = values.size() / columns;
    if (n == 0) source.fail("it holds no sample; give at least one");
    if (n > static_cast<std::size_t>(std::numeric_limits<Index>::max())) {
      source.fail("more than 2^31 - 1 samples; cut it into parts", ErrorCode::kTooLarge);
    }
    const auto stride = static_cast<Eigen::Index>(columns);
    const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> table(
        values.data(), static_cast<Eigen::Index>(n), stride);
    SampleSet samples;
    samples.positions = table.leftCols<3>();
    samples.radii = table.col(3);
    if (columns == 8) {
      samples.barycentrics = table.rightCols<3>();
      for (std::size_t i = 0; i < n; ++i) samples.facets.push_back(static_cast<Index>(values[8 * i + 4]));
    }
    return samples;
  }
};

SampleSet parse_xyzr(const IoSource& source) {
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
  return builder.finish(source);
}

SampleSet parse_ply_samples(const IoSource& source) {
  PlyReader reader(source);
  const PlyContent content = reader.read(kSampleColumns);
  const auto has = [&](std::size_t from, std::size_t to) {
    return std::count(content.found.begin() + static_cast<std::ptrdiff_t>(from),
                      content.found.begin() + static_cast<std::ptrdiff_t>(to), false) == 0;
  };
  if (!has(0, 4)) source.fail("its vertices have no x, y, z and radius; it is not a file of samples");
  SampleBuilder builder;
  builder.columns = has(4, 8) ? 8 : 4;
  for (std::size_t i = 0; i < content.at.size(); ++i) {
    const double* const row = content.values.data() + 8 * i;
    if (const char* const what = SampleBuilder::trouble(row, builder.columns)) reader.fail(content.at[i], what);
    builder.values.insert(builder.values.end(), row, row + builder.columns);
  }
  return builder.finish(source);
}

// The set as rows of 4 or 8 values; throws if it is not one read_samples would accept.
SampleBuilder sample_rows(const SampleSet& samples, bool with_place) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "samples: " + what); };
  const auto n = static_cast<std::size_t>(samples.positions.rows());
  const bool has_place = !samples.facets.empty();
  if (n == 0) fail("the set is empty; there is nothing to write");
  if (static_cast<std::size_t>(samples.radii.size()) != n || (has_place && samples.facets.size() != n) ||
      static_cast<std::size_t>(samples.barycentrics.rows()) != (has_place ? n : 0)) {
    fail("positions, radii, facets and barycentrics differ in length; give one of each per sample");
  }
  SampleBuilder rows;
  rows.columns = with_place && has_place ? 8 : 4;
  rows.values.reserve(n * rows.columns);
  for (std::size_t i = 0; i < n; ++i) {
    const auto r = static_cast<Eigen::Index>(i);
    double row[8] = {samples.positions(r, 0), samples.positions(r, 1), samples.positions(r, 2), samples.radii(r)};
    if (rows.columns == 8) {
      row[4] = samples.facets[i];
      for (int k = 0; k < 3; ++k) row[5 + k] = samples.barycentrics(r, k);
    }
    if (const char* const what = SampleBuilder::trouble(row, rows.columns)) fail("sample " + std::to_string(i) + ": " + what);
    rows.values.insert(rows.values.end(), row, row + rows.columns);
  }
  return rows;
}

std::string lower_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return extension;
}

}  // namespace
}  // namespace detail

MeshFormat mesh_format(const std::filesystem::path& path) {
  const std::string extension = detail::lower_extension(path);
  if (extension == ".obj") return MeshFormat::kObj;
  if (extension == ".off") return MeshFormat::kOff;
  if (extension == ".ply") return MeshFormat::kPly;
  if (extension == ".stl") return MeshFormat::kStl;
  throw Error(ErrorCode::kFileFormat,
              path.string() + ": \"" + extension + "\" is not an extension of a mesh file; use .obj, .off, .ply or .stl");
}

SampleFormat sample_format(const std::filesystem::path& path) {
  const std::string extension = detail::lower_extension(path);
  if (extension == ".xyzr") return SampleFormat::kXyzr;
  if (extension == ".ply") return SampleFormat::kPly;
  if (extension == ".csv") return SampleFormat::kCsv;
  throw Error(ErrorCode::kFileFormat,
              path.string() + ": \"" + extension + "\" is not an extension of a sample file; use .xyzr, .ply or .csv");
}

Mesh parse_mesh(std::string_view data, MeshFormat format, const std::string& name) {
  const detail::IoSource source{data, name};
  switch (format) {
    case MeshFormat::kObj:
      return detail::parse_obj(source);
    case MeshFormat::kOff:
      return detail::parse_off(source);
    case MeshFormat::kPly:
      return detail::parse_ply(source);
    case MeshFormat::kStl:
      break;
  }
  return detail::parse_stl(source);
}

Mesh read_mesh(std::istream& in, MeshFormat format, const std::string& name) {
  return parse_mesh(detail::read_whole_stream(in, name, 0), format, name);
}

Mesh read_mesh(const std::filesystem::path& path) {
  const MeshFormat format = mesh_format(path);
  return parse_mesh(detail::read_whole_file(path), format, path.string());
}

std::string format_mesh(const MeshView& mesh, MeshFormat format, const MeshWriteOptions& options) {
  detail::require_writable(mesh, format);
  if (format == MeshFormat::kPly) return detail::format_ply(mesh, options.ascii_ply);
  if (format == MeshFormat::kStl) return detail::format_stl(mesh);
  const bool obj = format == MeshFormat::kObj;
  std::string out;
  if (!obj) out = "OFF\n" + std::to_string(mesh.vertices.rows()) + ' ' + std::to_string(mesh.triangles.rows()) + " 0\n";
  for (Eigen::Index v = 0; v < mesh.vertices.rows(); ++v) detail::append_row(out, obj ? "v " : "", mesh.vertices.row(v).data());
  for (Eigen::Index f = 0; f < mesh.triangles.rows(); ++f) {
    detail::append_row(out, obj ? "f " : "3 ", mesh.triangles.row(f).data(), obj ? 1 : 0);
  }
  return out;
}

void write_mesh(std::ostream& out, const MeshView& mesh, MeshFormat format, const MeshWriteOptions& options) {
  const std::string data = format_mesh(mesh, format, options);
  out.write(data.data(), static_cast<std::streamsize>(data.size()));
  out.flush();
  if (!out) throw Error(ErrorCode::kFileNotFound, "stream: the mesh cannot be written to it; check what it leads to");
}

void write_mesh(const std::filesystem::path& path, const MeshView& mesh, const MeshWriteOptions& options) {
  detail::replace_file(path, format_mesh(mesh, mesh_format(path), options));
}

SampleSet parse_samples(std::string_view data, SampleFormat format, const std::string& name) {
  const detail::IoSource source{data, name};
  if (format == SampleFormat::kPly) return detail::parse_ply_samples(source);
  return format == SampleFormat::kCsv ? detail::parse_csv_samples(source) : detail::parse_xyzr(source);
}

SampleSet read_samples(const std::filesystem::path& path) {
  const SampleFormat format = sample_format(path);
  return parse_samples(detail::read_whole_file(path), format, path.string());
}

std::string format_samples(const SampleSet& samples, SampleFormat format) {
  const detail::SampleBuilder rows = detail::sample_rows(samples, format != SampleFormat::kXyzr);
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
  for (std::size_t i = 0; i < rows.values.size(); ++i) {
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
  return out;
}

void write_samples(const std::filesystem::path& path, const SampleSet& samples) {
  detail::replace_file(path, format_samples(samples, sample_format(path)));
}

Eigen::VectorXd parse_values(std::string_view data, const std::string& name) {
  const detail::IoSource source{data, name};
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
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

Eigen::VectorXd read_values(const std::filesystem::path& path) {
  return parse_values(detail::read_whole_file(path), path.string());
}

}  // namespace amps
