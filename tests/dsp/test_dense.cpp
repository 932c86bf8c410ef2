// Solutions and decompositions by what defines them.
#include <random>

#include "check.hpp"
#include "dsp/dense.hpp"

namespace {

using namespace servosense;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;

constexpr double kRounding = 1e-10;

MatrixXd random(Eigen::Index rows, Eigen::Index columns, std::mt19937& from) {
  std::normal_distribution<double> normal;
  MatrixXd a(rows, columns);
  for (double& x : a.reshaped()) x = normal(from);
  return a;
}

MatrixXcd random_complex(Eigen::Index rows, Eigen::Index columns, std::mt19937& from) {
  const MatrixXd real = random(rows, columns, from), imaginary = random(rows, columns, from);
  return real.cast<std::complex<double>>() + std::complex<double>(0, 1) * imaginary;
}

double largest(const auto& a) { return a.eval().cwiseAbs().maxCoeff(); }

void least_squares() {
  std::mt19937 from(1);
  const MatrixXd a = random(20, 4, from), b = random(20, 3, from);
  // What is left is at right angles to every column.
  CHECK(largest(a.transpose() * (b - a * dense::least_squares(a, b))) < kRounding);
  const VectorXd y = b.col(0);
  CHECK(largest(a.transpose() * (y - a * dense::least_squares(a, y))) < kRounding);
  const MatrixXcd c = random_complex(20, 4, from);
  const VectorXcd z = random_complex(20, 1, from);
  CHECK(largest(c.adjoint() * (z - c * dense::least_squares(c, z))) < kRounding);
  MatrixXd twice(20, 5);
  twice << a, a.col(1) + a.col(2);
  CHECK(dense::rank(a) == 4 && dense::rank(twice) == 4);
  const dense::ThinQr qr = dense::thin_qr(a);
  CHECK(largest(qr.q * qr.r - a) < kRounding);
  CHECK(largest(qr.q.transpose() * qr.q - MatrixXd::Identity(4, 4)) < kRounding);
  CHECK(qr.r(1, 0) == 0 && qr.r(3, 2) == 0);
  // Of all solutions the shortest: it has no part that the matrix does not see.
  const MatrixXd x = dense::least_norm(twice, b);
  VectorXd unseen = VectorXd::Zero(5);
  unseen << 0, 1, 1, 0, -1;
  CHECK(largest(twice.transpose() * (b - twice * x)) < kRounding);
  CHECK(largest(unseen.transpose() * x) < kRounding);
  const MatrixXd p = dense::pseudo_inverse(twice);
  CHECK(largest(p * b - x) < kRounding);
  CHECK(largest(twice * p * twice - twice) < kRounding && largest(p * twice * p - p) < kRounding);
}

void square() {
  std::mt19937 from(2);
  const MatrixXd a = random(6, 6, from), b = random(6, 2, from);
  const MatrixXd one = MatrixXd::Identity(6, 6);
  CHECK(largest(a * dense::inverse(a) - one) < kRounding);
  CHECK(largest(a * dense::solve(a, b) - b) < kRounding);
  const MatrixXcd c = random_complex(6, 6, from);
  const MatrixXd even = a * a.transpose();
  const VectorXd y = b.col(0);
  CHECK(largest(even * dense::solve_symmetric(even, y) - y) < kRounding);
  CHECK(largest(even * dense::inverse_symmetric(even) - one) < kRounding);
  const MatrixXd root = dense::cholesky_root(even);
  CHECK(largest(root * root.transpose() - even) < kRounding && root(0, 5) == 0);
  const MatrixXcd hermitian = c * c.adjoint(), right = random_complex(6, 2, from);
  CHECK(largest(hermitian * dense::solve_hermitian(hermitian, right) - right) < kRounding);
}

void spectra() {
  std::mt19937 from(3);
  const MatrixXd a = random(5, 5, from), even = a + a.transpose();
  const dense::SymmetricEigen e = dense::symmetric_eigen(even);
  CHECK(largest(even * e.vectors - e.vectors * e.values.asDiagonal()) < kRounding);
  CHECK(largest(e.vectors.transpose() * e.vectors - MatrixXd::Identity(5, 5)) < kRounding);
  for (Eigen::Index i = 1; i < 5; ++i) CHECK(e.values(i) >= e.values(i - 1));
  // Of (z - 1)(z - 2i)(z + 3): the roots of a companion matrix.
  const std::complex<double> i(0, 1), roots[] = {1, 2. * i, -3};
  MatrixXcd companion = MatrixXcd::Zero(3, 3);
  companion(1, 0) = companion(2, 1) = 1;
  companion.col(2) << -6. * i, 3. + 4. * i, -2. + 2. * i;
  const VectorXcd found = dense::eigenvalues(companion);
  for (const std::complex<double> root : roots)
    CHECK((found.array() - root).abs().minCoeff() < kRounding);
  // Next to -3 beside rounding: (z - 1) and (z - 2i) are 4 and 3.6 away.
  MatrixXcd shifted = companion;
  shifted.diagonal().array() += 3 - 1e-13;
  const VectorXcd vector = dense::vector_next_to_zero(shifted);
  CHECK(std::abs(vector.norm() - 1) < kRounding);
  CHECK(largest(companion * vector + 3. * vector) < kRounding);
  const MatrixXd tall = random(9, 4, from);
  const dense::SingularValues s = dense::singular_values(tall);
  CHECK(largest(s.u * s.values.asDiagonal() * s.v.transpose() - tall) < kRounding);
  CHECK(largest(s.u.transpose() * s.u - MatrixXd::Identity(4, 4)) < kRounding);
  for (Eigen::Index k = 1; k < 4; ++k) CHECK(s.values(k) <= s.values(k - 1));
}

}  // namespace

int main() {
  least_squares();
  square();
  spectra();
  return check::done();
}
