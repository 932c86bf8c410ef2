#include "dsp/dense.hpp"

#include <Eigen/Dense>

namespace servosense::dense {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;

MatrixXd least_squares(const MatrixXd& a, const MatrixXd& b) {
  return a.colPivHouseholderQr().solve(b);
}

VectorXd least_squares(const MatrixXd& a, const VectorXd& b) {
  return a.colPivHouseholderQr().solve(b);
}

VectorXcd least_squares(const MatrixXcd& a, const VectorXcd& b) {
  return a.colPivHouseholderQr().solve(b);
}

Eigen::Index rank(const MatrixXd& a) { return a.colPivHouseholderQr().rank(); }

ThinQr thin_qr(const MatrixXd& a) {
  const Eigen::HouseholderQR<MatrixXd> qr(a);
  return {qr.householderQ() * MatrixXd::Identity(a.rows(), a.cols()),
          qr.matrixQR().topRows(a.cols()).triangularView<Eigen::Upper>()};
}

VectorXd solve_symmetric(const MatrixXd& a, const VectorXd& b) { return a.ldlt().solve(b); }

MatrixXd inverse_symmetric(const MatrixXd& a) {
  return a.ldlt().solve(MatrixXd::Identity(a.rows(), a.cols()));
}

MatrixXcd solve_hermitian(const MatrixXcd& a, const MatrixXcd& b) { return a.ldlt().solve(b); }

MatrixXd cholesky_root(const MatrixXd& a) { return a.llt().matrixL(); }

MatrixXd inverse(const MatrixXd& a) { return a.inverse(); }

MatrixXd solve(const MatrixXd& a, const MatrixXd& b) { return a.partialPivLu().solve(b); }

MatrixXd pseudo_inverse(const MatrixXd& a) {
  return a.completeOrthogonalDecomposition().pseudoInverse();
}

MatrixXd least_norm(const MatrixXd& a, const MatrixXd& b) {
  return a.completeOrthogonalDecomposition().solve(b);
}

SymmetricEigen symmetric_eigen(const MatrixXd& a) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(a);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

VectorXcd eigenvalues(const MatrixXcd& a) {
  return Eigen::ComplexEigenSolver<MatrixXcd>(a, false).eigenvalues();
}

VectorXcd vector_next_to_zero(const MatrixXcd& a) {
  const Eigen::PartialPivLU<MatrixXcd> lu(a);
  VectorXcd vector = VectorXcd::Ones(a.rows());
  for (int step = 0; step < 2; ++step) vector = lu.solve(vector).normalized();
  return vector;
}

SingularValues singular_values(const MatrixXd& a) {
  const Eigen::JacobiSVD<MatrixXd> svd(a, Eigen::ComputeThinU | Eigen::ComputeThinV);
  return {svd.matrixU(), svd.matrixV(), svd.singularValues()};
}

}  // namespace servosense::dense
