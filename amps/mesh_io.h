// mesh_io.h: meshes and sample sets from and to files, streams and memory.
//
// Meshes: OBJ, OFF (text and binary, with C/N/ST prefixes), PLY (ascii, both binary byte orders), STL (ascii, binary).
// Samples: .xyzr (one `x y z r` a line), .ply and .csv. Nothing here depends on the locale, prints, or leaves a file half
// written. Every reader refuses what it cannot make sense of with one line that names the file, the line (text) or byte
// (binary), the trouble and the remedy.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/samples.h"

#include <array>
#include <cstddef>
#include <filesystem>
#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

namespace amps {

enum class MeshFormat { kObj, kOff, kPly, kStl };
enum class SampleFormat { kXyzr, kPly, kCsv };

/// The format a file name's extension stands for, upper or lower case (.obj .off .ply .stl; .xyzr .ply .csv). The file need
/// not exist. Throws Error(kFileFormat) for any other extension.
AMPS_EXPORT MeshFormat mesh_format(const std::filesystem::path& path);
AMPS_EXPORT SampleFormat sample_format(const std::filesystem::path& path);

/// Reads a triangle mesh. Polygons, concave ones and those with bridges to holes too, are cut into triangles that tile them,
/// keeping their orientation; Mesh::polygons says whose each triangle is, Mesh::crossing_polygons which cross themselves and
/// are cut into a fan from their first corner. Faces of fewer than three corners are dropped; triangles with repeated indices
/// are kept (check() reports them). Vertices keep number and order, but those of an STL, which has none, are merged where
/// equal. Normals, colours, texture coordinates, materials and groups are skipped. An OFF or PLY file may hold no facet at all;
/// an OBJ file must have a vertex, an ascii STL its `endsolid`.
///
/// Throws Error: kFileNotFound (cannot be opened or read), kFileFormat (unknown extension, cut short, not this format,
/// a coordinate that is not a finite number, an index out of range, counts larger than the file), kTooLarge (more vertices or
/// facets than an Index counts). O(file size) time; memory a small multiple of the file. Thread-safe.
/// Stopped through `execution`, as all functions here can be: kCancelled, and no file is touched. Its threads read the text of
/// OBJ, OFF and PLY files with a row to a line, and write meshes of all formats; what is read and written does not depend on
/// them.
AMPS_EXPORT Mesh read_mesh(const std::filesystem::path& path, const Execution& execution = {});

/// The same from a stream, read to its end (open it in binary mode), or from memory. `name` stands for the file in errors.
AMPS_EXPORT Mesh read_mesh(std::istream& in, MeshFormat format, const std::string& name = "stream",
                           const Execution& execution = {});
AMPS_EXPORT Mesh parse_mesh(std::string_view data, MeshFormat format, const std::string& name = "memory",
                            const Execution& execution = {});

/// What an OBJ file marks besides its facets, such as curves to be kept (CurveOptions::edges, vertices). Vertices have the
/// numbers that read_mesh() gives them.
struct MeshMarks {
  std::vector<std::array<Index, 2>> edges;  ///< neighbours along the lines (`l`), in the order of the file
  std::vector<Index> vertices;              ///< the points (`p`), in the order of the file
  std::vector<std::size_t> edge_lines;      ///< by edge: the line of the file it is on, from 1; for errors
  std::vector<std::size_t> vertex_lines;    ///< by vertex, likewise
  bool empty() const { return edges.empty() && vertices.empty(); }
};

/// Reads the lines and points of an OBJ file; all else in it is skipped unread, but for the number of vertices. Lines of fewer
/// than two vertices hold no edge. Throws as read_mesh; kFileFormat for other formats, which have no lines, and for an index
/// that is none of a vertex. Lines and points may come before their vertices. O(file size). Thread-safe.
AMPS_EXPORT MeshMarks read_mesh_marks(const std::filesystem::path& path, const Execution& execution = {});
AMPS_EXPORT MeshMarks parse_mesh_marks(std::string_view data, MeshFormat format, const std::string& name = "memory",
                                       const Execution& execution = {});

struct MeshWriteOptions {
  /// PLY as text instead of binary_little_endian. Both hold doubles exactly.
  bool ascii_ply = false;
  /// Pairs of vertices that OBJ files hold as lines (`l`), such as RemeshResult::curve_edges; other formats leave them out.
  /// They are a group of their own, `edges`: some readers take a group with lines for lines only.
  std::vector<std::array<Index, 2>> edges;
  /// Vertices that OBJ files hold as points (`p`), in a group `points`; other formats leave them out.
  std::vector<Index> vertices;
  /// #F, or empty: a number for each facet, such as its patch. PLY files hold it as an int property of faces, OBJ files as
  /// groups, NAME_NUMBER, in the order in which the numbers come: facets follow group by group, since many readers make an
  /// object of each group line. Other formats leave it out.
  std::vector<Index> labels;
  /// Their name: letters, digits and underscores.
  std::string label_name = "patch";
};

/// Writes a mesh in the format of the extension. Reading it back gives the same bits from OBJ, OFF and PLY: numbers in text are
/// the shortest that read back exactly (at most 17 significant digits), those in PLY are doubles. STL is binary and keeps
/// single precision only.
///
/// The file is written under a temporary name (.amps-0.tmp) in the same directory and renamed when complete, so a failure
/// leaves what was there before, and no temporary. What a killed program left, the next writer takes away. An existing file
/// keeps its permissions and owner; a link is followed; a file with other names (hard links) or of an owner that cannot be kept
/// so is written in place, as is a device or pipe; one that the caller may not write is refused. Access control lists are not
/// carried over. Throws Error: kFileNotFound (no directory, no permission, disk full), kFileFormat (unknown extension),
/// kInvalidMesh (coordinates that are not finite, or not in single precision for STL; indices out of range), kInvalidArgument
/// (labels that are not one a facet; a name of them that is no name). O(#V + #F).
AMPS_EXPORT void write_mesh(const std::filesystem::path& path, const MeshView& mesh, const MeshWriteOptions& options = {},
                            const Execution& execution = {});

/// The same to a stream (open it in binary mode; Error(kFileNotFound) if it fails; when cancelled, part of the mesh may be in
/// it), or to memory.
AMPS_EXPORT void write_mesh(std::ostream& out, const MeshView& mesh, MeshFormat format, const MeshWriteOptions& options = {},
                            const Execution& execution = {});
AMPS_EXPORT std::string format_mesh(const MeshView& mesh, MeshFormat format, const MeshWriteOptions& options = {},
                                    const Execution& execution = {});

/// Any content, such as a picture or a table beside a mesh, is written to a file as meshes are.
AMPS_EXPORT void write_file(const std::filesystem::path& path, const std::string& content, const Execution& execution = {});

/// Throws the Error(kFileNotFound) that writers would throw before they write, if it can be known: for a look before the work.
AMPS_EXPORT void require_writable_file(const std::filesystem::path& path);

/// Reads a sample set. .xyzr: four numbers a line; blank lines and `#` comments are skipped. .csv: a header line naming the
/// columns x, y, z, radius (or r) and, optionally, facet, b0, b1, b2 and dimension, curve, parameter, in any order; other
/// columns are skipped. .ply: vertex properties of these names. Facets and barycentrics are filled if all four columns are
/// there and left empty otherwise; so are dimensions, curves and parameters if all three are.
/// Throws as read_mesh, and kFileFormat for a radius that is not > 0, a facet that is not an index, a file with no sample,
/// a place on the curves that SampleSet does not know: a dimension other than 0, 1, 2, a curve that is not an index (−1 for
/// dimension 2), a parameter < 0, or one other than 0 off the curves.
AMPS_EXPORT SampleSet read_samples(const std::filesystem::path& path, const Execution& execution = {});
AMPS_EXPORT SampleSet read_samples(std::istream& in, SampleFormat format, const std::string& name = "stream",
                                   const Execution& execution = {});
AMPS_EXPORT SampleSet parse_samples(std::string_view data, SampleFormat format, const std::string& name = "memory",
                                    const Execution& execution = {});

/// Writes a sample set so that reading it gives the same bits; .ply (binary) and .csv carry facets and barycentrics, and
/// dimensions, curves and parameters, if present; .xyzr never. Files are replaced as by write_mesh. Throws as write_mesh, and
/// kInvalidArgument for a set that is empty, whose arrays differ in length, or with a value read_samples would refuse.
AMPS_EXPORT void write_samples(const std::filesystem::path& path, const SampleSet& samples, const Execution& execution = {});
AMPS_EXPORT void write_samples(std::ostream& out, const SampleSet& samples, SampleFormat format,
                               const Execution& execution = {});
AMPS_EXPORT std::string format_samples(const SampleSet& samples, SampleFormat format, const Execution& execution = {});

/// Reads numbers, any white space between, `#` comments skipped: one value a vertex, say, for vertex_sizing. Their count is for
/// the user to compare. Throws Error: kFileNotFound, kFileFormat (something that is no finite number, naming the line; no
/// number).
AMPS_EXPORT std::vector<double> read_values(const std::filesystem::path& path, const Execution& execution = {});
AMPS_EXPORT std::vector<double> parse_values(std::string_view data, const std::string& name = "memory",
                                             const Execution& execution = {});

/// A scalar property of the vertices of a PLY file, by its name ("quality", "radius", ...): one value a vertex. Throws as
/// read_mesh, and kFileFormat if the vertices have no such property or a value is not finite.
AMPS_EXPORT std::vector<double> read_vertex_property(const std::filesystem::path& path, const std::string& property,
                                                     const Execution& execution = {});
AMPS_EXPORT std::vector<double> parse_vertex_property(std::string_view data, const std::string& property,
                                                      const std::string& name = "memory", const Execution& execution = {});

}  // namespace amps

#include "amps/host_macros_end.h"
