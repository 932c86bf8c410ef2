#include "modes_poles.hpp"

#include <algorithm>
#include <cmath>

#include "dsp/dense.hpp"
#include "servosense/core/units.hpp"

namespace servosense::modes {
namespace {

using Complex = std::complex<double>;
using Matrix = Eigen::MatrixXcd;

constexpr Eigen::Index kRowsAtOnce = 2048;  // keeps the memory of long tables small
// A pole of the next order is the same pole within half its decay, or a thousandth of itself where
// it hardly decays.
constexpr double kSameOfDecay = 0.5, kSameOfItself = 1e-3;
constexpr int kFewestOrders = 3;
constexpr double kCircle = 1.05;  // over the band, so that its ends do not meet
constexpr double kBelowBand = kTwoPi * (kCircle - 1) / 2;

bool is_same(const Pole& a, const Pole& b) {
  const double width = std::max(kSameOfDecay * a.damping, kSameOfItself) * a.w_rad_s;
  return std::abs(a.upper() - b.upper()) < width;
}

/// Moments of one receptance: R = X^H X, S = -X^H H X, T = X^H |H|^2 X over the lines.
struct Moments {
  Matrix r, s, t;
};

Moments moments_of(const Lines& lines, double first_rad_s, double step_s, int highest) {
  const Eigen::Index n = highest + 1;
  Moments m{Matrix::Zero(n, n), Matrix::Zero(n, n), Matrix::Zero(n, n)};
  for (Eigen::Index from = 0; from < lines.count(); from += kRowsAtOnce) {
    const Eigen::Index rows = std::min(kRowsAtOnce, lines.count() - from);
    Matrix x(rows, n);
    for (Eigen::Index k = 0; k < rows; ++k) {
      const Complex u = std::exp(-(lines.s(from + k) - Complex(0, first_rad_s)) * step_s);
      Complex power = 1 / lines.noise(from + k);
      for (Eigen::Index j = 0; j < n; ++j) {
        x(k, j) = power;
        power *= u;
      }
    }
    const Matrix y = -(lines.response.segment(from, rows).asDiagonal() * x);
    m.r.noalias() += x.adjoint() * x;
    m.s.noalias() += x.adjoint() * y;
    m.t.noalias() += y.adjoint() * y;
  }
  return m;
}

/// Roots of u^n + a(n-1) u^(n-1) + ... + a(0).
Eigen::VectorXcd roots_of(const Eigen::VectorXcd& a) {
  const Eigen::Index n = a.size();
  Matrix companion = Matrix::Zero(n, n);
  for (Eigen::Index i = 0; i + 1 < n; ++i) companion(i + 1, i) = 1;
  companion.col(n - 1) = -a;
  return dense::eigenvalues(companion);
}

}  // namespace

std::vector<OrderPoles> poles_by_order(const std::vector<Lines>& lines, int highest,
                                       const std::function<void(double)>& progress) {
  double first = lines.front().w_rad_s(0), last = first;
  for (const Lines& l : lines) {
    first = std::min(first, l.w_rad_s(0));
    last = std::max(last, l.w_rad_s(l.count() - 1));
  }
  const double step_s = kTwoPi / (kCircle * (last - first));
  std::vector<Moments> moments;
  for (const Lines& l : lines) moments.push_back(moments_of(l, first, step_s, highest));
  std::vector<OrderPoles> orders;
  for (int order = 1; order <= highest; ++order) {
    const Eigen::Index n = order + 1;
    Matrix all = Matrix::Zero(n, n);
    for (const Moments& m : moments) {
      const Matrix s = m.s.topLeftCorner(n, n);
      all += m.t.topLeftCorner(n, n) -
             s.adjoint() * dense::solve_hermitian(m.r.topLeftCorner(n, n), s);
    }
    const Eigen::VectorXcd a =
        dense::solve_hermitian(all.topLeftCorner(order, order), -all.col(order).head(order));
    OrderPoles found{order, {}, {}};
    if (a.allFinite()) {
      for (const Complex u : roots_of(a)) {
        // The band is nearly the whole circle: what seems to lie far below it lies in its upper
        // half.
        const double turn = -std::arg(u) < -kBelowBand ? kTwoPi : 0;
        const Complex s = Complex(0, first) + (Complex(0, turn) - std::log(u)) / step_s;
        if (!(s.real() < 0) || !(s.imag() > 0) || !std::isfinite(std::abs(s))) continue;
        found.poles.push_back({std::abs(s), -s.real() / std::abs(s)});
      }
    }
    std::sort(found.poles.begin(), found.poles.end(),
              [](const Pole& l, const Pole& r) { return l.w_rad_s < r.w_rad_s; });
    found.stable.assign(found.poles.size(), false);
    orders.push_back(std::move(found));
    if (progress) progress(static_cast<double>(order) / highest);
  }
  return orders;
}

std::vector<Candidate> candidates_of(std::vector<OrderPoles>& orders) {
  struct Chain {
    std::vector<Pole> poles;
    int first, last;
  };
  std::vector<Chain> chains;
  for (OrderPoles& at : orders) {
    for (std::size_t i = 0; i < at.poles.size(); ++i) {
      const Pole& pole = at.poles[i];
      // The nearest chain that has no pole of this order yet.
      Chain* nearest = nullptr;
      for (Chain& chain : chains) {
        if (chain.last == at.order || !is_same(chain.poles.back(), pole)) continue;
        const auto distance = [&](const Chain& c) {
          return std::abs(c.poles.back().upper() - pole.upper());
        };
        if (nearest == nullptr || distance(chain) < distance(*nearest)) nearest = &chain;
      }
      if (nearest == nullptr) {
        chains.push_back({{pole}, at.order, at.order});
        continue;
      }
      at.stable[i] = nearest->last == at.order - 1;
      nearest->poles.push_back(pole);
      nearest->last = at.order;
    }
  }
  std::vector<Candidate> candidates;
  for (Chain& chain : chains) {
    const auto orders_found = static_cast<int>(chain.poles.size());
    if (orders_found < kFewestOrders) continue;
    // Of high orders more of the rest is told apart: the median of the later half.
    std::vector<Pole> late(chain.poles.begin() + orders_found / 2, chain.poles.end());
    const auto middle = [&late](double Pole::*value) {
      const auto at = late.begin() + static_cast<std::ptrdiff_t>(late.size() / 2);
      std::nth_element(late.begin(), at, late.end(),
                       [value](const Pole& l, const Pole& r) { return l.*value < r.*value; });
      return (*at).*value;
    };
    const double w = middle(&Pole::w_rad_s), damping = middle(&Pole::damping);
    candidates.push_back({{w, damping}, chain.first, orders_found});
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& l, const Candidate& r) { return l.pole.w_rad_s < r.pole.w_rad_s; });
  return candidates;
}

}  // namespace servosense::modes
