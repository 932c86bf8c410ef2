// Dense systems of equations by Eigen's decompositions, compiled once: each takes a compiler
// seconds in every file that names it.
#pragma once

#include <Eigen/Core>

namespace servosense::dense {

/// Least squares by QR with pivoted columns, for each column of `b`. Shapes: a (n, k), b (n, m),
/// result (k, m).
[[nodiscard]] Eigen::MatrixXd least_squares(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);
[[nodiscard]] Eigen::VectorXd least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);
[[nodiscard]] Eigen::VectorXcd least_squares(const Eigen::MatrixXcd& a, const Eigen::VectorXcd& b);

/// Columns that are independent to rounding, by the same decomposition.
[[nodiscard]] Eigen::Index rank(const Eigen::MatrixXd& a);

/// a = q r of independent columns: orthonormal q (n, k), upper triangular r (k, k).
struct ThinQr {
  Eigen::MatrixXd q, r;
};
[[nodiscard]] ThinQr thin_qr(const Eigen::MatrixXd& a);

/// a x = b for a symmetric `a` without negative eigenvalues (k, k), by Cholesky's decomposition.
[[nodiscard]] Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);
[[nodiscard]] Eigen::MatrixXd inverse_symmetric(const Eigen::MatrixXd& a);
/// The same of complex numbers: `a` equals its conjugate transpose.
[[nodiscard]] Eigen::MatrixXcd solve_hermitian(const Eigen::MatrixXcd& a,
                                               const Eigen::MatrixXcd& b);
/// The lower triangle l of a = l l' (k, k).
[[nodiscard]] Eigen::MatrixXd cholesky_root(const Eigen::MatrixXd& a);

/// Of a square matrix of full rank (k, k), by LU with pivoted rows.
[[nodiscard]] Eigen::MatrixXd inverse(const Eigen::MatrixXd& a);
[[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Moore and Penrose's, by complete orthogonal decomposition: what is not to be told apart is
/// shared out.
[[nodiscard]] Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& a);
/// pseudo_inverse(a) * b, without forming it.
[[nodiscard]] Eigen::MatrixXd least_norm(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Of a symmetric matrix: eigenvalues rising, eigenvectors in columns beside them.
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
[[nodiscard]] SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& a);

/// Of a square matrix, in no order.
[[nodiscard]] Eigen::VectorXcd eigenvalues(const Eigen::MatrixXcd& a);

/// Unit eigenvector to the eigenvalue that is next to zero, by inverse iteration: two steps, for
/// one that is zero to rounding. `a` is square and regular; it is factorised once.
[[nodiscard]] Eigen::VectorXcd vector_next_to_zero(const Eigen::MatrixXcd& a);

/// a = u diag(values) v', thin; values falling.
struct SingularValues {
  Eigen::MatrixXd u, v;
  Eigen::VectorXd values;
};
[[nodiscard]] SingularValues singular_values(const Eigen::MatrixXd& a);

}  // namespace servosense::dense
