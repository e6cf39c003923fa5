// cli_keep.h: --keep: lines and points of an OBJ file, as edges and corners of a mesh that has vertices at the same positions.
#pragma once

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_files.h"
#include "cli_output.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <vector>

/// The vertices of a mesh at the positions of another file's vertices: bit by bit, but −0 equals 0.
class MatchedVertices {
 public:
  MatchedVertices(const amps::MeshView& mesh, const amps::MeshView& other, const amps::Execution& execution) : other_(other) {
    for (amps::Index v = 0; v < other.num_vertices(); ++v) places_.push_back(position(other, v));
    std::sort(places_.begin(), places_.end());
    places_.erase(std::unique(places_.begin(), places_.end()), places_.end());
    vertex_at_.assign(places_.size(), amps::kNone);
    place_of_.reserve(static_cast<std::size_t>(mesh.num_vertices()));
    for (amps::Index v = 0; v < mesh.num_vertices(); ++v) {
      if (v % kRowsPerLook == 0) execution.check();
      place_of_.push_back(place(position(mesh, v)));
      if (place_of_.back() == amps::kNone) continue;
      amps::Index& first = vertex_at_[static_cast<std::size_t>(place_of_.back())];
      if (first == amps::kNone) first = v;
    }
  }

  /// Number of the distinct position of a vertex of the other file.
  amps::Index place_of_other(amps::Index v) const { return place(position(other_, v)); }
  /// The same of a vertex of the mesh; kNone: the other file has none there.
  amps::Index place_of(amps::Index v) const { return place_of_[static_cast<std::size_t>(v)]; }
  /// The first vertex of the mesh there; kNone: it has none.
  amps::Index vertex_at(amps::Index place) const { return vertex_at_[static_cast<std::size_t>(place)]; }
  std::size_t places() const { return places_.size(); }

  static constexpr amps::Index kRowsPerLook = 1 << 14;

 private:
  using Position = std::array<double, 3>;
  static Position position(const amps::MeshView& mesh, amps::Index v) {
    return {mesh.vertices(v, 0), mesh.vertices(v, 1), mesh.vertices(v, 2)};
  }
  amps::Index place(const Position& x) const {
    const auto found = std::lower_bound(places_.begin(), places_.end(), x);
    return found == places_.end() || *found != x ? amps::kNone : static_cast<amps::Index>(found - places_.begin());
  }

  amps::MeshView other_;
  std::vector<Position> places_;  // ascending
  std::vector<amps::Index> vertex_at_, place_of_;
};

/// The lines and points of an OBJ file as marked edges and corners of a mesh. Throws Error(kFileFormat) naming the first line
/// that marks nothing: a vertex that the mesh does not have, a pair of vertices without an edge, a point on no facet. A piece
/// of a line between two vertices of one position marks nothing, and is left out.
class KeptMarks {
 public:
  KeptMarks(const Files& files, const std::string& file, const std::string& mesh_file, const amps::Mesh& mesh,
            const amps::Execution& execution)
      : file_(Files::shown(file, Files::kInput)),
        mesh_file_(Files::shown(mesh_file, Files::kInput)),
        marks_(files.marks(file, execution.part(0, 0.3))) {
    if (marks_.empty()) fail("no line (l) and no point (p) is in it; mark edges of the mesh by lines, corners by points");
    drawn_ = files.mesh(file, execution.part(0.3, 0.6));
    const MatchedVertices matched(mesh, drawn_, execution.part(0.6, 0.8));
    find_edges(matched);
    look_over(mesh, matched, execution.part(0.8, 1));
    require_all(matched);
  }

  void mark(amps::CurveOptions& options) const {
    options.edges = edges_;
    options.vertices = vertices_;
  }

 private:
  using Pair = std::array<amps::Index, 2>;
  static Pair sorted(amps::Index a, amps::Index b) { return a < b ? Pair{a, b} : Pair{b, a}; }

  [[noreturn]] void fail(const std::string& what) const {
    throw amps::Error(amps::ErrorCode::kFileFormat, file_ + ": " + what);
  }
  [[noreturn]] void fail(std::size_t line, const std::string& what) const {
    fail("line " + std::to_string(line) + ": " + what);
  }
  std::string shown(amps::Index v) const {
    const amps::Vec3 x = amps::MeshView(drawn_).vertices[v];
    return "vertex " + std::to_string(v + 1) + format(" (%.9g, %.9g, %.9g)", x.x(), x.y(), x.z());
  }

  void find_edges(const MatchedVertices& matched) {
    for (const Pair& edge : marks_.edges) {
      pairs_.push_back(sorted(matched.place_of_other(edge[0]), matched.place_of_other(edge[1])));
    }
    wanted_ = pairs_;
    std::sort(wanted_.begin(), wanted_.end());
    wanted_.erase(std::unique(wanted_.begin(), wanted_.end()), wanted_.end());
    is_edge_.assign(wanted_.size(), false);
    on_facet_.assign(matched.places(), false);
  }
  std::size_t wanted(const Pair& pair) const {
    const auto found = std::lower_bound(wanted_.begin(), wanted_.end(), pair);
    return found == wanted_.end() || *found != pair ? wanted_.size() : static_cast<std::size_t>(found - wanted_.begin());
  }

  /// Which of them the facets have. Facets with two corners at one position are no part of the surface.
  void look_over(const amps::Mesh& mesh, const MatchedVertices& matched, const amps::Execution& execution) {
    const amps::MeshView view(mesh);
    for (amps::Index f = 0; f < view.num_facets(); ++f) {
      if (f % MatchedVertices::kRowsPerLook == 0) execution.check();
      std::array<amps::Index, 3> place{};
      for (int k = 0; k < 3; ++k) place[static_cast<std::size_t>(k)] = matched.place_of(view.triangles(f, k));
      if (std::max({place[0], place[1], place[2]}) == amps::kNone) continue;
      const amps::Vec3 a = view.corner(f, 0), b = view.corner(f, 1), c = view.corner(f, 2);
      if (a == b || b == c || c == a) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        if (place[k] == amps::kNone) continue;
        on_facet_[static_cast<std::size_t>(place[k])] = true;
        const std::size_t edge = wanted(sorted(place[k], place[(k + 1) % 3]));
        if (edge < wanted_.size()) is_edge_[edge] = true;
      }
    }
  }

  void require_vertex(const MatchedVertices& matched, amps::Index v, std::size_t line) const {
    if (matched.vertex_at(matched.place_of_other(v)) != amps::kNone) return;
    fail(line, shown(v) + " is where " + mesh_file_ + " has no vertex; give vertices at exactly the same positions");
  }
  void require_all(const MatchedVertices& matched) {
    for (std::size_t i = 0; i < marks_.edges.size(); ++i) {
      const Pair edge = marks_.edges[i];
      if (edge[0] == edge[1]) {
        fail(marks_.edge_lines[i], "a line from " + shown(edge[0]) + " to itself is no edge; name two vertices");
      }
      for (const amps::Index v : edge) require_vertex(matched, v, marks_.edge_lines[i]);
      if (pairs_[i][0] == pairs_[i][1]) continue;
      if (!is_edge_[wanted(pairs_[i])]) {
        fail(marks_.edge_lines[i], "from " + shown(edge[0]) + " to " + shown(edge[1]) + " there is no edge of " + mesh_file_ +
                                       "; follow its edges one by one, or remove the line");
      }
      edges_.push_back({matched.vertex_at(pairs_[i][0]), matched.vertex_at(pairs_[i][1])});
    }
    for (std::size_t i = 0; i < marks_.vertices.size(); ++i) {
      const amps::Index v = marks_.vertices[i];
      require_vertex(matched, v, marks_.vertex_lines[i]);
      if (!on_facet_[static_cast<std::size_t>(matched.place_of_other(v))]) {
        fail(marks_.vertex_lines[i], shown(v) + " is on no facet of " + mesh_file_ + "; remove the point");
      }
      vertices_.push_back(matched.vertex_at(matched.place_of_other(v)));
    }
  }

  std::string file_, mesh_file_;
  amps::MeshMarks marks_;
  amps::Mesh drawn_;            // what the file has: of it, vertices
  std::vector<Pair> pairs_;     // by line piece: places of its ends
  std::vector<Pair> wanted_;    // the same, sorted, each once
  std::vector<bool> is_edge_;   // by wanted_
  std::vector<bool> on_facet_;  // by place
  std::vector<Pair> edges_;     // of the mesh
  std::vector<amps::Index> vertices_;
};

/// --keep, for the mesh that was read from the first operand.
inline void keep_marks(const Arguments& arguments, const Files& files, const amps::Mesh& mesh, const amps::Execution& execution,
                       amps::CurveOptions& options) {
  if (!arguments.has("--keep")) return;
  KeptMarks(files, arguments.text("--keep"), arguments.operand(0), mesh, execution).mark(options);
}
