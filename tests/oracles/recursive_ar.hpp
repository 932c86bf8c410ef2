// Recursive AR models as Bertok 1984 prints them (repaired): the covariance forms, and the fast
// transversal recursion, which loses its footing in float. References for dsp/lattice_ar.hpp only.
#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <cstddef>
#include <vector>

namespace oracle {

/// Eq. 3.18 and 3.19 with P(0) = E, V = variance; `forgetting` as in weighted least squares.
template <typename Real>
class CovarianceAr {
 public:
  using Vector = Eigen::Matrix<Real, Eigen::Dynamic, 1>;
  using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
  CovarianceAr(int order, Real variance, Real forgetting = 1)
      : past(Vector::Zero(order)),
        model(Vector::Zero(order)),
        covariance(Matrix::Identity(order, order)),
        variance_(variance),
        forgetting_(forgetting) {}
  Real process(Real z) {
    const Real e = z - past.dot(model);
    const Vector pm = covariance * past;
    const Real below = forgetting_ * variance_ + past.dot(pm);
    model += pm / below * e;
    covariance = ((covariance - pm * pm.transpose() / below) / forgetting_).eval();
    for (Eigen::Index i = past.size() - 1; i > 0; --i) past[i] = past[i - 1];
    past[0] = z;
    return e;
  }
  Vector past, model;
  Matrix covariance;

 private:
  Real variance_, forgetting_;
};

/// Eq. 3.3 to 3.5: the inverse of the covariance is carried along.
class BayesAr {
 public:
  BayesAr(int order, double variance)
      : model(Eigen::VectorXd::Zero(order)),
        information(Eigen::MatrixXd::Identity(order, order)),
        past_(Eigen::VectorXd::Zero(order)),
        variance_(variance) {}
  double process(double z) {
    const double e = z - past_.dot(model);
    information += past_ * past_.transpose() / variance_;
    model += information.ldlt().solve(past_) / variance_ * e;
    for (Eigen::Index i = past_.size() - 1; i > 0; --i) past_[i] = past_[i - 1];
    past_[0] = z;
    return e;
  }
  Eigen::VectorXd model;
  Eigen::MatrixXd information;

 private:
  Eigen::VectorXd past_;
  double variance_;
};

/// Eq. 5.5 to 5.14 (Ljung, Morf and Falconer 1978); A = -X.
template <typename Real>
class FastTransversalAr {
 public:
  using Vector = Eigen::Matrix<Real, Eigen::Dynamic, 1>;
  FastTransversalAr(int order, Real variance)
      : A(Vector::Zero(order)),
        gain_(Vector::Zero(order)),
        B_(Vector::Zero(order)),
        D_(Vector::Zero(order)),
        z_(Vector::Zero(order)),
        variance_(variance) {}
  Real process(Real zeta) {
    const Eigen::Index p = A.size();
    const Real xi = zeta / variance_;
    const Real eps0 = zeta + A.dot(z_);
    A -= gain_ * eps0;
    B_ += z_ * xi;
    const Real eps = xi - B_.dot(gain_);
    energy += eps * eps0;
    Vector longer(p + 1);
    longer[0] = eps / energy;
    longer.tail(p) = gain_ + A * (eps / energy);
    const Vector m = longer.head(p);
    const Real mu = longer[p];
    const Real leaving = z_[p - 1];
    for (Eigen::Index i = p - 1; i > 0; --i) z_[i] = z_[i - 1];
    z_[0] = zeta;
    const Real eta0 = leaving + D_.dot(z_);
    const Real below = 1 - mu * eta0;
    healthy = healthy && energy > 0 && below > 0 && below <= Real(1.000001);
    D_ = ((D_ - m * eta0) / below).eval();
    gain_ = m - D_ * mu;
    return eps0;
  }
  Vector A;
  Real energy = 1;
  bool healthy = true;

 private:
  Vector gain_, B_, D_, z_;
  Real variance_;
};

}  // namespace oracle
