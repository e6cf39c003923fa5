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
#include <map>
#include <numeric>
#include <ostream>
#include <utility>
#include <vector>

namespace amps {
namespace detail {
namespace {

// OBJ

/// The vertices of a face, line or point up to the end of the text line; each is v, v/t, v//n or v/t/n, 1-based or, if
/// negative, counted back from the last vertex so far. `element`: what it is, for errors.
void read_obj_indices(TextCursor& text, std::int64_t num_vertices, const char* element, std::vector<Index>& indices) {
  indices.clear();
  while (text.more_on_line()) {
    const std::string_view word = text.token();
    const char* p = word.data();
    const char* const end = p + word.size();
    std::int64_t index = 0;
    if (!parse_integer(p, end, index) || (p < end && *p != '/')) {
      text.source.fail_line(
          word.data(), "expected a vertex index, found \"" + TextCursor::shown(word) + "\"; correct or remove the " + element);
    }
    const std::int64_t zero_based = index < 0 ? num_vertices + index : index - 1;
    if (zero_based < 0 || zero_based >= std::numeric_limits<Index>::max()) {
      fail_index(text.source, word.data(), index, num_vertices, 1, false, element);
    }
    indices.push_back(static_cast<Index>(zero_based));
  }
}

/// The greatest index met and where it stands: elements may come before their vertices, so the range is checked at the end.
struct ObjGreatest {
  Index index = kNone;
  const char* where = nullptr;

  void meet(const std::vector<Index>& indices, const char* line) {
    for (const Index i : indices) {
      if (i <= index) continue;
      index = i;
      where = line;
    }
  }
  void require_below(std::int64_t num_vertices, const IoSource& source, const char* element) const {
    if (index >= num_vertices) fail_index(source, where, std::int64_t{index} + 1, num_vertices, 1, false, element);
  }
};

constexpr const char* kNoObj = "no line \"v x y z\" in it; it is not an OBJ file";

/// The whole file, or a piece of it, where no vertex is known that may be counted back from.
void parse_obj_lines(const IoSource& source, bool whole, MeshBuilder& builder, ObjGreatest& greatest) {
  TextCursor text(source);
  text.continuation = true;
  std::vector<Index> corners;
  while (text.next_content()) {
    const char* const line = text.p;
    const std::string_view keyword = text.token();
    if (keyword == "v") {
      double xyz[3];
      read_coordinates(text, line, xyz, "an OBJ file");  // a weight or colour behind them is skipped
      builder.add_vertex(xyz);
    } else if (keyword == "f") {
      read_obj_indices(text, whole ? builder.num_vertices() : 0, "face", corners);
      greatest.meet(corners, line);
      builder.add_polygon(corners);
    }
    text.skip_line();
  }
}

/// On all threads. False, and nothing read, if there is anything in it that is wrong or needs what is before its piece.
bool parse_obj_in_pieces(const IoSource& source, MeshBuilder& builder, ObjGreatest& greatest) {
  const std::vector<std::string_view> pieces = text_pieces(source.data, source.run);
  std::vector<MeshBuilder> builders(pieces.size(), MeshBuilder(source));
  std::vector<ObjGreatest> greatests(pieces.size());
  const bool complete = parse_pieces(
      source, pieces, [&](std::size_t k, const IoSource& piece) { parse_obj_lines(piece, false, builders[k], greatests[k]); });
  if (!complete) return false;
  builder.append_all(builders);
  for (const ObjGreatest& of_piece : greatests) {
    if (of_piece.index > greatest.index) greatest = of_piece;
  }
  return true;
}

Mesh parse_obj(const IoSource& source) {
  MeshBuilder builder(source);
  ObjGreatest greatest;
  if (!worth_pieces(source, source.begin()) || !parse_obj_in_pieces(source, builder, greatest)) {
    parse_obj_lines(source, true, builder, greatest);
  }
  if (builder.num_vertices() == 0) source.fail(kNoObj);
  greatest.require_below(builder.num_vertices(), source, "face");
  return builder.finish();
}

MeshMarks parse_obj_marks(const IoSource& source) {
  MeshMarks marks;
  TextCursor text(source);
  text.continuation = true;
  ObjGreatest greatest_of_lines, greatest_of_points;
  std::int64_t num_vertices = 0;
  std::size_t line_number = 1;
  const char* counted = source.begin();  // lines are counted up to here
  std::vector<Index> indices;
  while (text.next_content()) {
    const char* const line = text.p;
    const std::string_view keyword = text.token();
    if (keyword == "v") {
      ++num_vertices;
    } else if (keyword == "l" || keyword == "p") {
      line_number += source.lines_between(counted, line);
      counted = line;
      if (keyword == "l") {
        read_obj_indices(text, num_vertices, "line", indices);
        greatest_of_lines.meet(indices, line);
        for (std::size_t k = 1; k < indices.size(); ++k) marks.edges.push_back({indices[k - 1], indices[k]});
        marks.edge_lines.resize(marks.edges.size(), line_number);
      } else {
        read_obj_indices(text, num_vertices, "point", indices);
        greatest_of_points.meet(indices, line);
        marks.vertices.insert(marks.vertices.end(), indices.begin(), indices.end());
        marks.vertex_lines.resize(marks.vertices.size(), line_number);
      }
    }
    text.skip_line();
  }
  if (num_vertices == 0) source.fail(kNoObj);
  greatest_of_lines.require_below(num_vertices, source, "line");
  greatest_of_points.require_below(num_vertices, source, "point");
  return marks;
}

void require_lines(MeshFormat format, const std::string& name) {
  if (format == MeshFormat::kObj) return;
  throw Error(ErrorCode::kFileFormat, name + ": no lines can be in it, they are in OBJ files only; save it as .obj");
}

// OFF

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

/// Do the faces of a binary file, with the number of parts of a colour behind each or, as some programs have it, without, end
/// where the file does?
bool off_faces_end_file(const IoSource& source, const char* p, std::int64_t faces, bool big_endian, bool colored) {
  const auto skip = [&] {  // a number, and as many others
    if (p > source.end() || source.end() - p < 4) return false;
    const std::int64_t size = load_as<std::int32_t, std::uint32_t>(p, big_endian);
    if (size < 0 || size > (source.end() - p) / 4 - 1) return false;
    p += 4 + 4 * size;
    return true;
  };
  constexpr std::int64_t faces_per_look = 1 << 20;
  for (std::int64_t f = 0; f < faces; ++f) {
    if (f % faces_per_look == 0) source.run.report(0);
    if (!skip() || (colored && !skip())) return false;
  }
  return p == source.end();
}

Mesh parse_binary_off(TextCursor& text, const OffHeader& header) {
  const IoSource& source = text.source;
  const char* p = text.p;
  const auto need = [&](std::int64_t bytes, const char* what) {
    if (source.end() - p < bytes) source.fail_byte(p, std::string("the file ends inside ") + what + "; it is cut short");
  };
  need(12, "the counts");
  const std::int64_t stride = 4 * header.floats_per_vertex;
  // Big-endian by definition, but some programs write the order of their machine: counts that fit tell. A face takes four bytes
  // at least, and four more with its colours.
  const auto plausible = [&](bool big_endian) {
    const std::int64_t left = source.end() - p - 12;
    const std::int64_t v = load_as<std::int32_t, std::uint32_t>(p, big_endian);
    const std::int64_t f = load_as<std::int32_t, std::uint32_t>(p + 4, big_endian);
    return v >= 0 && f >= 0 && v <= left / stride && f <= left / 4;
  };
  const bool big_endian = plausible(true) || !plausible(false);
  const auto next_int = [&p, big_endian] {
    p += 4;
    return std::int64_t{load_as<std::int32_t, std::uint32_t>(p - 4, big_endian)};
  };
  const std::int64_t vertices = next_int(), faces = next_int();
  next_int();  // edges
  require_plausible(source, vertices, faces, stride, 4, source.end() - p);
  const bool colored = !off_faces_end_file(source, p + stride * vertices, faces, big_endian, false) ||
                       off_faces_end_file(source, p + stride * vertices, faces, big_endian, true);
  MeshBuilder builder(source);
  builder.reserve(static_cast<std::size_t>(vertices), static_cast<std::size_t>(faces));
  for (std::int64_t v = 0; v < vertices; ++v, p += stride) {
    source.look(p);
    need(stride, "the vertices");
    double xyz[3];
    for (int k = 0; k < 3; ++k) xyz[k] = static_cast<double>(load_as<float, std::uint32_t>(p + 4 * k, big_endian));
    if (!all_finite(xyz)) source.fail_byte(p, kNotFinite);
    builder.add_vertex(xyz);
  }
  std::vector<Index> corners;
  for (std::int64_t f = 0; f < faces; ++f) {
    source.look(p);
    need(4, "the faces");
    const std::int64_t size = next_int();
    if (size < 0) source.fail_byte(p - 4, "a face of " + std::to_string(size) + " corners; it is not a binary OFF file");
    need(4 * size + (colored ? 4 : 0), "the faces");
    corners.clear();
    for (std::int64_t k = 0; k < size; ++k) {
      const std::int64_t index = next_int();
      if (index < 0 || index >= vertices) fail_index(source, p - 4, index, vertices, 0, true);
      corners.push_back(static_cast<Index>(index));
    }
    const std::int64_t colors = colored ? next_int() : 0;
    if (colors < 0) source.fail_byte(p - 4, "a colour of " + std::to_string(colors) + " parts; it is not a binary OFF file");
    need(4 * colors, "the faces");
    p += 4 * colors;
    builder.add_polygon(corners);
  }
  return builder.finish();
}

/// Reads lines from `row` up to `end`: of a vertex each, then of a face each.
void parse_off_rows(TextCursor& text, const OffHeader& header, std::int64_t row, std::int64_t end, MeshBuilder& builder) {
  const IoSource& source = text.source;
  const auto next_line = [&](const char* what, std::int64_t done, std::int64_t wanted) {
    if (text.next_content()) return text.p;
    source.fail("its header promises " + std::to_string(wanted) + " " + what + ", but it ends after " + std::to_string(done) +
                "; the file is cut short");
  };
  for (; row < std::min(header.vertices, end); ++row) {
    const char* const line = next_line("vertices", row, header.vertices);
    double xyz[3];
    read_coordinates(text, line, xyz, "an OFF file");  // normals, colours, texture coordinates behind them are skipped
    builder.add_vertex(xyz);
    text.skip_line();
  }
  std::vector<Index> corners;
  for (; row < end; ++row) {
    const char* const line = next_line("faces", row - header.vertices, header.faces);
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
}

/// On all threads, if there is one row to a line. False, and nothing read, if there is not, or anything is wrong.
bool parse_off_in_pieces(const TextCursor& text, const OffHeader& header, MeshBuilder& builder) {
  const IoSource& source = text.source;
  const std::int64_t rows = header.vertices + header.faces;
  RowPieces cut(source, text.p, rows);
  if (!cut.complete()) return false;
  std::vector<MeshBuilder> builders(cut.pieces.size(), MeshBuilder(source));
  const bool complete = parse_pieces(source, cut.pieces, [&](std::size_t k, const IoSource& piece) {
    TextCursor lines(piece);
    parse_off_rows(lines, header, cut.first_row(k), cut.first_row(k + 1), builders[k]);
    if (cut.first_row(k + 1) < rows && lines.next_content()) throw NotByItself();
  });
  if (complete) builder.append_all(builders);
  return complete;
}

Mesh parse_off(const IoSource& source) {
  TextCursor text(source);
  const OffHeader header = read_off_header(text);
  if (header.binary) return parse_binary_off(text, header);
  require_plausible(source, header.vertices, header.faces, 6, 2, source.end() - text.p + 1);
  MeshBuilder builder(source);
  builder.reserve(static_cast<std::size_t>(header.vertices), static_cast<std::size_t>(header.faces));
  if (!worth_pieces(source, text.p) || !parse_off_in_pieces(text, header, builder)) {
    parse_off_rows(text, header, 0, header.vertices + header.faces, builder);
  }
  return builder.finish();
}

// PLY

Mesh parse_ply(const IoSource& source) {
  PlyReader reader(source);
  MeshBuilder builder(source);
  PlyContent content = reader.read({"x", "y", "z"}, builder);
  if (content.num_vertices > 0 && !(content.found[0] && content.found[1] && content.found[2])) {
    source.fail("its vertices have no x, y and z; it is not a PLY mesh");
  }
  for (std::size_t i = 0; i < content.at.size(); ++i) {
    if (!all_finite(content.values.data() + 3 * i)) reader.fail(content.at[i], kNotFinite);
  }
  builder.set_coordinates(std::move(content.values));
  return builder.finish();
}

/// What looks like a damaged file of any format, but is a good one in wraps.
void refuse_encodings(const IoSource& source) {
  const auto starts_with = [&](std::string_view bytes) { return source.data.substr(0, bytes.size()) == bytes; };
  if (starts_with("\x1F\x8B\x08")) source.fail("it is compressed by gzip; uncompress it first");
  if (starts_with("\xFF\xFE") || starts_with("\xFE\xFF")) source.fail("it is text in UTF-16; save it as UTF-8");
}

// STL

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
    source.look(p);
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
  // Corners are merged afterwards: of binary files, that is most of the work.
  const auto merged = [&source](double share_of_reading, auto&& read) {
    const IoSource reading{source.data, source.name, source.run.part(0, share_of_reading)};
    const Mesh corners = read(reading);
    return merge_equal_vertices(corners, source.run.part(share_of_reading, 1));
  };
  const auto size = static_cast<std::int64_t>(source.data.size());
  const std::int64_t facets = size < 84 ? -1 : load_bytes<std::uint32_t>(source.begin() + 80, false);
  constexpr std::int64_t max_facets = std::numeric_limits<Index>::max() / 3;
  const bool exact_size = facets >= 0 && size == 84 + 50 * facets;
  TextCursor text(source);
  const bool says_solid = text.next_content() && equal_ignoring_case(text.token(), "solid");
  const bool has_zeros = source.data.substr(0, 512).find('\0') != std::string_view::npos;
  if (!exact_size && says_solid && !has_zeros) return merged(0.7, parse_ascii_stl);
  if (facets < 0) source.fail("it neither starts with solid nor has the 84 bytes of a header; it is not an STL file");
  if (size < 84 + 50 * facets) {
    source.fail("its header promises " + std::to_string(facets) + " facets, more than " + std::to_string(size) +
                " bytes can hold; the file is cut short or is not an STL file");
  }
  if (facets == 0 && size > 84) source.fail("its header promises no facet, but data follows; it is not an STL file");
  if (facets > max_facets) source.fail("more than 2^31 - 1 corners; cut it into parts", ErrorCode::kTooLarge);
  return merged(0.25, [facets](const IoSource& reading) { return parse_binary_stl(reading, facets); });
}

// Writing meshes

/// Three doubles as text take so many times as long as three indices.
constexpr double kVertexTextCost = 4;

/// Room for a line of text: most fit. To copy what is written because it outgrows its room would take long.
constexpr std::size_t kVertexTextBytes = 64, kFacetTextBytes = 28, kLabelTextBytes = 6;

/// Whatever the format: what is left out is looked at all the same.
void require_write_options(const MeshView& mesh, const MeshWriteOptions& options) {
  const auto refuse = [](ErrorCode code, const std::string& what) { throw Error(code, "writing: " + what); };
  const auto named = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  };
  for (const std::array<Index, 2>& edge : options.edges) {
    if (std::min(edge[0], edge[1]) >= 0 && std::max(edge[0], edge[1]) < mesh.num_vertices()) continue;
    refuse(ErrorCode::kInvalidMesh, "an edge from vertex " + std::to_string(edge[0]) + " to " + std::to_string(edge[1]) +
                                        ", but the mesh has " + std::to_string(mesh.num_vertices()) +
                                        "; give pairs of its vertices");
  }
  for (const Index vertex : options.vertices) {
    if (vertex >= 0 && vertex < mesh.num_vertices()) continue;
    refuse(ErrorCode::kInvalidMesh, "a point at vertex " + std::to_string(vertex) + ", but the mesh has " +
                                        std::to_string(mesh.num_vertices()) + "; give its vertices");
  }
  if (options.labels.empty()) return;
  if (options.labels.size() != slot(mesh.num_facets())) {
    refuse(ErrorCode::kInvalidArgument, std::to_string(options.labels.size()) + " labels for " +
                                            std::to_string(mesh.num_facets()) + " facets; give one a facet, or none");
  }
  if (options.label_name.empty() || !std::all_of(options.label_name.begin(), options.label_name.end(), named)) {
    refuse(ErrorCode::kInvalidArgument, "label_name must be of letters, digits and underscores");
  }
}

void require_writable(const MeshView& mesh, MeshFormat format) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidMesh, "mesh: " + what); };
  const double max_coordinate =
      format == MeshFormat::kStl ? static_cast<double>(std::numeric_limits<float>::max()) : std::numeric_limits<double>::max();
  for (std::ptrdiff_t v = 0; v < mesh.vertices.rows(); ++v) {
    for (int k = 0; k < 3; ++k) {
      const double x = std::abs(mesh.vertices(v, k));
      if (x <= max_coordinate) continue;  // false for NaN
      fail("vertex " + std::to_string(v) + " (0-based) has a coordinate that is " +
           (std::isfinite(x) ? "too large for STL; write PLY, OBJ or OFF" : "NaN or infinite; correct it before writing"));
    }
  }
  for (std::ptrdiff_t f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      if (mesh.triangles(f, k) >= 0 && mesh.triangles(f, k) < mesh.vertices.rows()) continue;
      fail("facet " + std::to_string(f) + " (0-based) has a corner that is not a vertex; correct it before writing");
    }
  }
}

// "prefix a b c\n", with `offset` added to indices.
void append_row(std::string& out, const char* prefix, const Vec3& row) {
  out += prefix;
  for (int k = 0; k < 3; ++k) {
    if (k > 0) out += ' ';
    append_number(out, row[k]);
  }
  out += '\n';
}
void append_row(std::string& out, const char* prefix, const std::array<Index, 3>& row, int offset) {
  out += prefix;
  for (int k = 0; k < 3; ++k) {
    if (k > 0) out += ' ';
    append_number(out, std::int64_t{row[static_cast<std::size_t>(k)]} + offset);
  }
  out += '\n';
}

/// Appends row(text, k) for k in [0, n), some `row_bytes` each, on all threads: pieces of rows are written side by side, some
/// at a time, so that they stay in the caches until they are put together.
template <class Row>
void append_rows(std::string& out, std::size_t n, std::size_t row_bytes, const Execution& run, const Row& row) {
  constexpr std::size_t kPiecesPerWorker = 4;
  const std::size_t workers = run.workers();
  if (workers == 1 || n <= kRowsPerLook) {
    for_each_piece(n, kRowsPerLook, run, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) row(out, k);
    });
    return;
  }
  std::vector<std::string> texts(kPiecesPerWorker * workers);
  for_each_piece(n, texts.size() * kRowsPerLook, run, [&](std::size_t begin, std::size_t end) {
    parallel_for(end - begin, kRowsPerLook, run, [&](std::size_t from, std::size_t to) {
      std::string& text = texts[from / kRowsPerLook];
      text.clear();
      text.reserve(row_bytes * (to - from));
      for (std::size_t k = begin + from; k < begin + to; ++k) row(text, k);
    });
    for (std::size_t from = begin; from < end; from += kRowsPerLook) out += texts[(from - begin) / kRowsPerLook];
  });
}

/// The part of the time that vertices take, where a facet takes 1.
double share_of_vertices(const MeshView& mesh, double vertex_cost) {
  const double vertices = vertex_cost * mesh.num_vertices();
  return vertices / std::max(vertices + mesh.num_facets(), 1.0);
}

std::string format_stl(const MeshView& mesh, const Execution& run) {
  constexpr std::size_t kFacetBytes = 50;
  std::string out = "binary STL by amps";  // must not start with "solid"
  out.resize(80, ' ');
  append_little_endian<std::uint32_t>(out, static_cast<std::uint32_t>(mesh.num_facets()));
  out.reserve(84 + kFacetBytes * slot(mesh.num_facets()));
  const Points normals = facet_normals(mesh, run.part(0, 0.3));
  append_rows(out, slot(mesh.num_facets()), kFacetBytes, run.part(0.3, 1), [&](std::string& text, std::size_t row) {
    const auto f = static_cast<Index>(row);
    for (int k = 0; k < 3; ++k) append_float(text, normals(f, k));
    for (int corner = 0; corner < 3; ++corner) {
      for (int k = 0; k < 3; ++k) append_float(text, mesh.vertices(mesh.triangles(f, corner), k));
    }
    text.append(2, '\0');
  });
  return out;
}

std::string format_ply(const MeshView& mesh, const MeshWriteOptions& options, const Execution& run) {
  const bool ascii = options.ascii_ply, labelled = !options.labels.empty();
  const std::size_t num_vertices = slot(mesh.num_vertices()), num_facets = slot(mesh.num_facets());
  std::string out = "ply\nformat ";
  out += ascii ? "ascii" : "binary_little_endian";
  out += " 1.0\nelement vertex " + std::to_string(mesh.vertices.rows());
  out += "\nproperty double x\nproperty double y\nproperty double z\nelement face " + std::to_string(mesh.triangles.rows());
  out += "\nproperty list uchar int vertex_indices\n";
  if (labelled) out += "property int " + options.label_name + '\n';
  out += "end_header\n";
  const std::size_t vertex_bytes = ascii ? kVertexTextBytes : 24;
  const std::size_t facet_bytes = (ascii ? kFacetTextBytes : 13) + (labelled ? (ascii ? kLabelTextBytes : 4) : 0);
  out.reserve(out.size() + vertex_bytes * num_vertices + facet_bytes * num_facets);
  const double share = share_of_vertices(mesh, ascii ? kVertexTextCost : 1);
  append_rows(out, num_vertices, vertex_bytes, run.part(0, share), [&](std::string& text, std::size_t row) {
    const Vec3 x = mesh.vertices[static_cast<std::ptrdiff_t>(row)];
    if (ascii) return append_row(text, "", x);
    for (int k = 0; k < 3; ++k) append_little_endian<std::uint64_t>(text, x[k]);
  });
  append_rows(out, num_facets, facet_bytes, run.part(share, 1), [&](std::string& text, std::size_t row) {
    const auto f = static_cast<std::ptrdiff_t>(row);
    if (ascii) {
      append_row(text, "3 ", mesh.triangles[f], 0);
      if (!labelled) return;
      text.back() = ' ';
      append_number(text, std::int64_t{options.labels[row]});
      text += '\n';
    } else {
      text += '\3';
      for (int k = 0; k < 3; ++k) append_little_endian<std::uint32_t>(text, mesh.triangles(f, k));
      if (labelled) append_little_endian<std::uint32_t>(text, options.labels[row]);
    }
  });
  return out;
}

/// Places of the labels, those of one number one after another: numbers in the order in which they come.
std::vector<std::size_t> group_by_group(const std::vector<Index>& labels) {
  std::map<Index, std::size_t> rank;
  for (const Index label : labels) rank.emplace(label, rank.size());
  std::vector<std::size_t> order(labels.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return rank.at(labels[a]) < rank.at(labels[b]); });
  return order;
}

std::string format_obj(const MeshView& mesh, const MeshWriteOptions& options, const Execution& run) {
  const std::size_t num_vertices = slot(mesh.num_vertices()), num_facets = slot(mesh.num_facets());
  const std::size_t num_marks = options.edges.size() + options.vertices.size();
  const double vertices = kVertexTextCost * static_cast<double>(num_vertices), facets = static_cast<double>(num_facets);
  const double all = std::max(vertices + facets + static_cast<double>(num_marks), 1.0);
  std::string out;
  out.reserve(kVertexTextBytes * num_vertices + kFacetTextBytes * (num_facets + num_marks));
  append_rows(out, num_vertices, kVertexTextBytes, run.part(0, vertices / all), [&](std::string& text, std::size_t row) {
    append_row(text, "v ", mesh.vertices[static_cast<std::ptrdiff_t>(row)]);
  });
  const std::vector<std::size_t> order = group_by_group(options.labels);
  const Execution writing_facets = run.part(vertices / all, (vertices + facets) / all);
  append_rows(out, num_facets, kFacetTextBytes, writing_facets, [&](std::string& text, std::size_t k) {
    const std::size_t f = order.empty() ? k : order[k];
    if (!order.empty() && (k == 0 || options.labels[f] != options.labels[order[k - 1]])) {
      text += "g " + options.label_name + '_' + std::to_string(options.labels[f]) + '\n';
    }
    append_row(text, "f ", mesh.triangles[static_cast<std::ptrdiff_t>(f)], 1);
  });
  Ticker ticker(run.part((vertices + facets) / all, 1), num_marks, kRowsPerLook);
  if (!options.edges.empty()) out += "g edges\n";
  for (const std::array<Index, 2>& edge : options.edges) {
    ticker.tick();
    out += "l " + std::to_string(edge[0] + 1) + ' ' + std::to_string(edge[1] + 1) + '\n';
  }
  if (!options.vertices.empty()) out += "g points\n";
  for (const Index vertex : options.vertices) {
    ticker.tick();
    out += "p " + std::to_string(vertex + 1) + '\n';
  }
  return out;
}

std::string format_off(const MeshView& mesh, const Execution& run) {
  const std::size_t num_vertices = slot(mesh.num_vertices()), num_facets = slot(mesh.num_facets());
  std::string out = "OFF\n" + std::to_string(num_vertices) + ' ' + std::to_string(num_facets) + " 0\n";
  out.reserve(out.size() + kVertexTextBytes * num_vertices + kFacetTextBytes * num_facets);
  const double share = share_of_vertices(mesh, kVertexTextCost);
  append_rows(out, num_vertices, kVertexTextBytes, run.part(0, share), [&](std::string& text, std::size_t row) {
    append_row(text, "", mesh.vertices[static_cast<std::ptrdiff_t>(row)]);
  });
  append_rows(out, num_facets, kFacetTextBytes, run.part(share, 1), [&](std::string& text, std::size_t row) {
    append_row(text, "3 ", mesh.triangles[static_cast<std::ptrdiff_t>(row)], 0);
  });
  return out;
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

Mesh parse_mesh(std::string_view data, MeshFormat format, const std::string& name, const Execution& execution) {
  const Execution run = execution.start("reading");
  const auto parse = [&] {
    const detail::IoSource source{data, name, run};
    detail::refuse_encodings(source);
    if (format == MeshFormat::kObj) return detail::parse_obj(source);
    if (format == MeshFormat::kOff) return detail::parse_off(source);
    if (format == MeshFormat::kPly) return detail::parse_ply(source);
    return detail::parse_stl(source);
  };
  Mesh mesh = parse();
  run.finish();
  return mesh;
}

Mesh read_mesh(std::istream& in, MeshFormat format, const std::string& name, const Execution& execution) {
  const Execution run = execution.start("reading");
  const std::string data = detail::read_whole_stream(in, name, 0, run.part(0, detail::kShareOfDisk));
  Mesh mesh = parse_mesh(data, format, name, run.part(detail::kShareOfDisk, 1));
  run.finish();
  return mesh;
}

Mesh read_mesh(const std::filesystem::path& path, const Execution& execution) {
  const MeshFormat format = mesh_format(path);
  const Execution run = execution.start("reading");
  const std::string data = detail::read_whole_file(path, run.part(0, detail::kShareOfDisk));
  Mesh mesh = parse_mesh(data, format, path.string(), run.part(detail::kShareOfDisk, 1));
  run.finish();
  return mesh;
}

MeshMarks parse_mesh_marks(std::string_view data, MeshFormat format, const std::string& name, const Execution& execution) {
  detail::require_lines(format, name);
  const Execution run = execution.start("reading");
  MeshMarks marks = detail::parse_obj_marks({data, name, run});
  run.finish();
  return marks;
}

MeshMarks read_mesh_marks(const std::filesystem::path& path, const Execution& execution) {
  const MeshFormat format = mesh_format(path);
  detail::require_lines(format, path.string());
  const Execution run = execution.start("reading");
  const std::string data = detail::read_whole_file(path, run.part(0, detail::kShareOfDisk));
  MeshMarks marks = parse_mesh_marks(data, format, path.string(), run.part(detail::kShareOfDisk, 1));
  run.finish();
  return marks;
}

std::string format_mesh(const MeshView& mesh, MeshFormat format, const MeshWriteOptions& options, const Execution& execution) {
  detail::require_writable(mesh, format);
  detail::require_write_options(mesh, options);
  const Execution run = execution.start("writing");
  const auto formatted = [&] {
    if (format == MeshFormat::kObj) return detail::format_obj(mesh, options, run);
    if (format == MeshFormat::kOff) return detail::format_off(mesh, run);
    if (format == MeshFormat::kPly) return detail::format_ply(mesh, options, run);
    return detail::format_stl(mesh, run);
  };
  std::string data = formatted();
  run.finish();
  return data;
}

void write_mesh(std::ostream& out, const MeshView& mesh, MeshFormat format, const MeshWriteOptions& options,
                const Execution& execution) {
  const Execution run = execution.start("writing");
  const std::string data = format_mesh(mesh, format, options, run.part(0, 1 - detail::kShareOfDisk));
  detail::write_whole_stream(out, data, run.part(1 - detail::kShareOfDisk, 1));
  run.finish();
}

void write_mesh(const std::filesystem::path& path, const MeshView& mesh, const MeshWriteOptions& options,
                const Execution& execution) {
  const MeshFormat format = mesh_format(path);
  const Execution run = execution.start("writing");
  const std::string data = format_mesh(mesh, format, options, run.part(0, 1 - detail::kShareOfDisk));
  detail::replace_file(path, data, run.part(1 - detail::kShareOfDisk, 1));
  run.finish();
}

void write_file(const std::filesystem::path& path, const std::string& content, const Execution& execution) {
  const Execution run = execution.start("writing");
  detail::replace_file(path, content, run);
  run.finish();
}

void require_writable_file(const std::filesystem::path& path) { detail::require_replaceable(path); }

}  // namespace amps
