// Each case must not compile (check_no_view.cmake): what is named has no memory that a view could look at for long, or not in
// this shape.
#include "amps/mesh.h"

Eigen::MatrixXd matrix();

void try_it(const Eigen::MatrixXd& v, const Eigen::MatrixXf& vf, const Eigen::MatrixXi& f, const Eigen::Matrix3Xd& columns) {
  static_cast<void>(columns);
#if AMPS_CASE == 0  // compiles: the other cases fail for their own reason
  const amps::MeshView view(v, f);
  const amps::MeshView floats(vf, f);
#elif AMPS_CASE == 1
  const amps::MeshView view(vf.cast<double>(), f);
#elif AMPS_CASE == 2
  const amps::MeshView view(v * 2.0, f);
#elif AMPS_CASE == 3
  const amps::MeshView view(v, f.array() - 1);
#elif AMPS_CASE == 4
  const amps::MeshView view(matrix(), f);
#elif AMPS_CASE == 5
  const amps::MeshView view(f, f);
#elif AMPS_CASE == 6
  const amps::MeshView view(v, v);
#elif AMPS_CASE == 7
  const amps::MeshView view(columns, f);
#elif AMPS_CASE == 8
  const amps::ValuesView view(v.rowwise().norm());
#endif
}
