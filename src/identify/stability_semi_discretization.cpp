#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <thread>

#include "servosense/identify/semi_discretization.hpp"
#include "stability_loop.hpp"

namespace servosense {
namespace {

using Complex = std::complex<double>;
using Eigen::MatrixXd;
using Eigen::VectorXd;
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr int kHighestOrder = 6;
constexpr int kQuadraturePoints = 12;

/// Gauss-Legendre rule on 0..1; exact to rounding for the smooth integrands of one interval.
struct Quadrature {
  std::array<double, kQuadraturePoints> at{};
  std::array<double, kQuadraturePoints> weight{};

  Quadrature() {
    constexpr int n = kQuadraturePoints;
    for (int i = 0; i < n; ++i) {
      double x = std::cos(kPi * (i + 0.75) / (n + 0.5));
      double slope = 1;
      for (int newton = 0; newton < 50; ++newton) {
        double p = 1;
        double before = 0;
        for (int k = 1; k <= n; ++k) {
          const double next = ((2 * k - 1) * x * p - (k - 1) * before) / k;
          before = p;
          p = next;
        }
        slope = n * (x * p - before) / (x * x - 1);
        const double step = p / slope;
        x -= step;
        if (std::abs(step) < 1e-16) break;
      }
      at[static_cast<std::size_t>(i)] = 0.5 * (1 + x);
      weight[static_cast<std::size_t>(i)] = 1 / ((1 - x * x) * slope * slope);
    }
  }
};

/// One mode; its state is (q, q'/wn), so that both have the unit of a displacement.
struct Oscillator {
  double wn, zeta, mass;
  int direction;  ///< index of the tool tip displacement it adds to

  struct Free {
    double qq, qp, pq, pp;
  };
  /// State after `t` without force.
  [[nodiscard]] Free free(double t) const {
    const double r = 1 / std::sqrt(1 - zeta * zeta);
    const double decay = std::exp(-zeta * wn * t);
    const double s = decay * std::sin(wn * t / r);
    const double c = decay * std::cos(wn * t / r);
    return {c + r * zeta * s, r * s, -r * s, c - r * zeta * s};
  }
  /// State after `t` from a unit impulse is (qp, pp) of free(t) times this.
  [[nodiscard]] double impulse() const { return 1 / (mass * wn); }
};

/// Exact response over one interval of given length to a polynomial force, for every mode.
struct Stencil {
  double length_s = 0;
  std::vector<Oscillator::Free> free;  ///< [mode * order + node - 1]
  std::vector<double> q;               ///< [(mode * order + node - 1) * (order + 1) + force node]
  std::vector<double> p;               ///< [mode * (order + 1) + force node], at the end
};

/// A stretch of the tooth period between two entries or exits, or a flight between two cuts.
struct Segment {
  double length_s = 0;
  bool in_cut = false;
  int intervals = 0;
  std::size_t stencil = 0;
  std::size_t first_node = 0;      ///< in the memory of the deflection
  std::size_t first_interval = 0;  ///< in the coefficient store
  std::vector<Oscillator::Free> flight;
};

/// The map of one tooth period to the next.
class ToothPassMap {
 public:
  ToothPassMap(const Structure& structure, const MillingTool& tool, const Engagement& engagement,
               const SemiDiscretizationConfig& config, double spindle_speed_rpm,
               double axial_depth_m);

  [[nodiscard]] std::size_t size() const { return 2 * modes_.size() + directions_ * nodes_; }
  [[nodiscard]] const std::vector<Oscillator>& modes() const { return modes_; }
  void apply(const double* before, double* after) const;

 private:
  using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor,
                              2 * kHighestOrder, 2 * kHighestOrder>;

  [[nodiscard]] std::size_t stencil_of(double length_s);
  void prepare(const Segment& segment, double start_rad, double width_rad, double lag_rad,
               const MillingTool& tool, const Engagement& engagement, double half_depth_kt);

  std::size_t order_;
  std::size_t directions_ = 0;
  std::array<bool, 2> moves_{};  ///< x, y
  std::array<double, kHighestOrder + 1> nodes_at_{};
  std::vector<Oscillator> modes_;
  std::vector<Stencil> stencils_;
  std::vector<Segment> segments_;
  std::size_t nodes_ = 0;
  std::size_t intervals_ = 0;
  std::vector<double> stiffness_;  ///< per interval and node: force per deflection, 2 x 2 or 1
  std::vector<double> solve_;      ///< per interval: inverse of the implicit system
};

ToothPassMap::ToothPassMap(const Structure& structure, const MillingTool& tool,
                           const Engagement& engagement, const SemiDiscretizationConfig& config,
                           double spindle_speed_rpm, double axial_depth_m)
    : order_(static_cast<std::size_t>(config.hold_order)) {
  moves_ = {!structure.x.empty(), !structure.y.empty()};
  for (const auto* modes : {&structure.x, &structure.y}) {
    if (modes->empty()) continue;
    for (const StructuralMode& m : *modes)
      modes_.push_back({m.natural_frequency_rad_s(), m.damping_ratio, m.modal_mass_kg,
                        static_cast<int>(directions_)});
    ++directions_;
  }
  double fastest = 0;
  for (const Oscillator& m : modes_) fastest = std::max(fastest, m.wn);
  for (std::size_t i = 0; i <= order_; ++i)
    nodes_at_[i] = 0.5 * (1 - std::cos(kPi * static_cast<double>(i) / static_cast<double>(order_)));

  const double pitch = kTwoPi / tool.teeth;
  const double spin = rad_s_from_rpm(spindle_speed_rpm);
  double lag = axial_depth_m * std::tan(rad_from_deg(tool.helix_deg)) / tool.radius_m();
  if (lag < 1e-6) lag = 0;  // a difference of angles this small would be mostly rounding

  // Phases at which a tooth, or the end of its helix, comes in or goes out; counted from an entry.
  const double start = engagement.start_rad;
  std::vector<double> breaks = {0, pitch};
  for (const double edge : {engagement.exit_rad, start + lag, engagement.exit_rad + lag}) {
    const double phase = std::fmod(edge - start, pitch);
    breaks.push_back(phase);
  }
  std::sort(breaks.begin(), breaks.end());
  breaks.erase(std::unique(breaks.begin(), breaks.end(),
                           [&](double a, double b) { return b - a < 1e-9 * pitch; }),
               breaks.end());
  breaks.back() = pitch;

  for (std::size_t i = 0; i + 1 < breaks.size(); ++i) {
    const double width = breaks[i + 1] - breaks[i];
    const double middle = start + 0.5 * (breaks[i] + breaks[i + 1]);
    Segment segment;
    segment.length_s = width / spin;
    // The tooth that entered last decides: earlier ones are further on.
    segment.in_cut = std::fmod(middle - start, pitch) < engagement.exit_rad + lag - start;
    if (!segment.in_cut) {
      for (const Oscillator& m : modes_) segment.flight.push_back(m.free(segment.length_s));
      segments_.push_back(std::move(segment));
      continue;
    }
    const double by_phase = fastest * segment.length_s / config.phase_per_interval_rad;
    const double by_angle = width / 0.5;  // the directional coefficients turn at twice the angle
    segment.intervals = std::max(1, static_cast<int>(std::ceil(std::max(by_phase, by_angle))));
    segment.stencil = stencil_of(segment.length_s / segment.intervals);
    const bool continues = !segments_.empty() && segments_.back().in_cut;
    segment.first_node = continues ? nodes_ - 1 : nodes_;
    segment.first_interval = intervals_;
    nodes_ = segment.first_node + static_cast<std::size_t>(segment.intervals) * order_ + 1;
    intervals_ += static_cast<std::size_t>(segment.intervals);
    prepare(segment, start + breaks[i], width, lag, tool, engagement,
            0.5 * axial_depth_m * tool.force.tangential_coefficient_N_per_m2);
    segments_.push_back(std::move(segment));
  }
}

std::size_t ToothPassMap::stencil_of(double length_s) {
  for (std::size_t i = 0; i < stencils_.size(); ++i)
    if (std::abs(stencils_[i].length_s - length_s) <= 1e-14 * length_s) return i;
  static const Quadrature rule;
  Stencil stencil;
  stencil.length_s = length_s;
  // Lagrange polynomials through the nodes.
  const auto basis = [this](std::size_t j, double x) {
    double value = 1;
    for (std::size_t k = 0; k <= order_; ++k)
      if (k != j) value *= (x - nodes_at_[k]) / (nodes_at_[j] - nodes_at_[k]);
    return value;
  };
  const std::size_t forces = order_ + 1;
  stencil.q.assign(modes_.size() * order_ * forces, 0);
  stencil.p.assign(modes_.size() * forces, 0);
  stencil.free.resize(modes_.size() * order_);
  for (std::size_t node = 1; node <= order_; ++node) {
    const double until = nodes_at_[node];
    for (std::size_t m = 0; m < modes_.size(); ++m)
      stencil.free[m * order_ + node - 1] = modes_[m].free(until * length_s);
    for (std::size_t k = 0; k < kQuadraturePoints; ++k) {
      const double x = until * rule.at[k];
      std::array<double, kHighestOrder + 1> held{};
      for (std::size_t j = 0; j < forces; ++j)
        held[j] = basis(j, x) * rule.weight[k] * until * length_s;
      for (std::size_t m = 0; m < modes_.size(); ++m) {
        const Oscillator::Free kick = modes_[m].free((until - x) * length_s);
        const double scale = modes_[m].impulse();
        double* q = &stencil.q[(m * order_ + node - 1) * forces];
        for (std::size_t j = 0; j < forces; ++j) q[j] += scale * kick.qp * held[j];
        if (node == order_)
          for (std::size_t j = 0; j < forces; ++j)
            stencil.p[m * forces + j] += scale * kick.pp * held[j];
      }
    }
  }
  stencils_.push_back(std::move(stencil));
  return stencils_.size() - 1;
}

void ToothPassMap::prepare(const Segment& segment, double start_rad, double width_rad,
                           double lag_rad, const MillingTool& tool, const Engagement& engagement,
                           double half_depth_kt) {
  const double pitch = kTwoPi / tool.teeth;
  const double ratio = tool.force.radial_ratio;
  const double first_angle = engagement.start_rad;
  const double last_angle = engagement.exit_rad + lag_rad;
  const double middle = start_rad + 0.5 * width_rad;
  // Teeth in the cut all through this segment, as turns of one pitch.
  const int from = static_cast<int>(std::ceil((first_angle - middle) / pitch));
  const int to = static_cast<int>(std::floor((last_angle - middle) / pitch));
  const auto coefficients = [&](double phase) {
    DirectionalCoefficients sum;
    for (int tooth = from; tooth <= to; ++tooth) {
      const double angle = phase + tooth * pitch;
      if (lag_rad > 0) {  // mean over the depth, the edge lagging more the higher it is
        const auto clamped = [&](double x) {
          return std::clamp(x, engagement.start_rad, engagement.exit_rad);
        };
        const auto part = engagement_integral({clamped(angle - lag_rad), clamped(angle)}, ratio);
        sum.xx += part.xx / lag_rad;
        sum.xy += part.xy / lag_rad;
        sum.yx += part.yx / lag_rad;
        sum.yy += part.yy / lag_rad;
      } else {
        const double s = std::sin(2 * angle);
        const double c = std::cos(2 * angle);
        sum.xx -= s + ratio * (1 - c);
        sum.xy -= (1 + c) + ratio * s;
        sum.yx += (1 - c) - ratio * s;
        sum.yy += s - ratio * (1 + c);
      }
    }
    return sum;
  };

  const std::size_t dirs = directions_;
  const std::size_t unknowns = order_ * dirs;
  const std::size_t forces = order_ + 1;
  const Stencil& stencil = stencils_[segment.stencil];
  // Deflection of the tool tip at a node from the force held at another.
  std::vector<double> influence(dirs * order_ * forces, 0);
  for (std::size_t m = 0; m < modes_.size(); ++m) {
    double* sum = &influence[static_cast<std::size_t>(modes_[m].direction) * order_ * forces];
    for (std::size_t i = 0; i < order_ * forces; ++i) sum[i] += stencil.q[m * order_ * forces + i];
  }
  stiffness_.resize(intervals_ * forces * dirs * dirs);
  solve_.resize(intervals_ * unknowns * unknowns);
  for (int n = 0; n < segment.intervals; ++n) {
    const std::size_t interval = segment.first_interval + static_cast<std::size_t>(n);
    double* k = &stiffness_[interval * forces * dirs * dirs];
    for (std::size_t j = 0; j < forces; ++j) {
      const double phase = start_rad + width_rad * (n + nodes_at_[j]) / segment.intervals;
      const DirectionalCoefficients a = coefficients(phase);
      double* kj = k + j * dirs * dirs;
      if (dirs == 2) {
        kj[0] = half_depth_kt * a.xx;
        kj[1] = half_depth_kt * a.xy;
        kj[2] = half_depth_kt * a.yx;
        kj[3] = half_depth_kt * a.yy;
      } else {
        kj[0] = half_depth_kt * (moves_[0] ? a.xx : a.yy);
      }
    }
    const auto size = static_cast<Eigen::Index>(unknowns);
    Small system = Small::Identity(size, size);
    for (std::size_t i = 0; i < order_; ++i)
      for (std::size_t r = 0; r < dirs; ++r)
        for (std::size_t j = 1; j <= order_; ++j)
          for (std::size_t c = 0; c < dirs; ++c)
            system(static_cast<Eigen::Index>(i * dirs + r),
                   static_cast<Eigen::Index>((j - 1) * dirs + c)) -=
                influence[(r * order_ + i) * forces + j] * k[(j * dirs + r) * dirs + c];
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
        &solve_[interval * unknowns * unknowns], size, size) = system.partialPivLu().inverse();
  }
}

void ToothPassMap::apply(const double* before, double* after) const {
  const std::size_t dirs = directions_;
  const std::size_t forces = order_ + 1;
  const std::size_t unknowns = order_ * dirs;
  double* state = after;
  std::copy(before, before + 2 * modes_.size(), state);
  const double* memory = before + 2 * modes_.size();
  double* deflection = after + 2 * modes_.size();

  for (const Segment& segment : segments_) {
    if (!segment.in_cut) {
      for (std::size_t m = 0; m < modes_.size(); ++m) {
        const Oscillator::Free& f = segment.flight[m];
        const double q = state[2 * m];
        const double p = state[2 * m + 1];
        state[2 * m] = f.qq * q + f.qp * p;
        state[2 * m + 1] = f.pq * q + f.pp * p;
      }
      continue;
    }
    const Stencil& stencil = stencils_[segment.stencil];
    for (std::size_t d = 0; d < dirs; ++d) deflection[segment.first_node * dirs + d] = 0;
    for (std::size_t m = 0; m < modes_.size(); ++m)
      deflection[segment.first_node * dirs + static_cast<std::size_t>(modes_[m].direction)] +=
          state[2 * m];

    for (std::size_t n = 0; n < static_cast<std::size_t>(segment.intervals); ++n) {
      const std::size_t interval = segment.first_interval + n;
      const double* old = memory + (segment.first_node + n * order_) * dirs;
      double* now = deflection + (segment.first_node + n * order_) * dirs;
      const double* k = &stiffness_[interval * forces * dirs * dirs];
      double force[(kHighestOrder + 1) * 2];  // [node][direction]
      const auto push = [&](std::size_t node, const double* chip) {
        for (std::size_t r = 0; r < dirs; ++r) {
          double sum = 0;
          for (std::size_t c = 0; c < dirs; ++c) sum += k[(node * dirs + r) * dirs + c] * chip[c];
          force[node * dirs + r] = sum;
        }
      };
      double chip[2];
      for (std::size_t d = 0; d < dirs; ++d) chip[d] = now[d] - old[d];
      push(0, chip);

      // What the deflection would change by since one tooth ago, but for the force in this interval
      // beyond its first node.
      double known[kHighestOrder * 2];
      for (std::size_t i = 0; i < unknowns; ++i) known[i] = -old[dirs + i];
      for (std::size_t m = 0; m < modes_.size(); ++m) {
        const auto d = static_cast<std::size_t>(modes_[m].direction);
        for (std::size_t i = 0; i < order_; ++i) {
          const Oscillator::Free& f = stencil.free[m * order_ + i];
          known[i * dirs + d] += f.qq * state[2 * m] + f.qp * state[2 * m + 1] +
                                 stencil.q[(m * order_ + i) * forces] * force[d];
        }
      }
      const double* inverse = &solve_[interval * unknowns * unknowns];
      double change[kHighestOrder * 2];
      for (std::size_t i = 0; i < unknowns; ++i) {
        double sum = 0;
        for (std::size_t j = 0; j < unknowns; ++j) sum += inverse[i * unknowns + j] * known[j];
        change[i] = sum;
        now[dirs + i] = sum + old[dirs + i];
      }
      for (std::size_t j = 1; j <= order_; ++j) push(j, change + (j - 1) * dirs);

      for (std::size_t m = 0; m < modes_.size(); ++m) {
        const auto d = static_cast<std::size_t>(modes_[m].direction);
        const Oscillator::Free& f = stencil.free[m * order_ + order_ - 1];
        const double* wq = &stencil.q[(m * order_ + order_ - 1) * forces];
        const double* wp = &stencil.p[m * forces];
        double q = f.qq * state[2 * m] + f.qp * state[2 * m + 1];
        double p = f.pq * state[2 * m] + f.pp * state[2 * m + 1];
        for (std::size_t j = 0; j < forces; ++j) {
          q += wq[j] * force[j * dirs + d];
          p += wp[j] * force[j * dirs + d];
        }
        state[2 * m] = q;
        state[2 * m + 1] = p;
      }
    }
  }
}

/// Largest eigenvalue of a Hessenberg matrix.
Complex largest_eigenvalue(const MatrixXd& hessenberg) {
  const Eigen::Index k = hessenberg.rows();
  Eigen::RealSchur<MatrixXd> schur(k);
  schur.computeFromHessenberg(hessenberg, MatrixXd::Identity(k, k), false);
  const MatrixXd& t = schur.matrixT();
  Complex largest = 0;
  for (Eigen::Index i = 0; i < k; ++i) {
    Complex value = t(i, i);
    if (i + 1 < k && t(i + 1, i) != 0) {  // a complex pair
      const double half = 0.5 * (t(i, i) - t(i + 1, i + 1));
      const double inside = half * half + t(i, i + 1) * t(i + 1, i);
      value = {t(i + 1, i + 1) + half, std::sqrt(std::abs(inside))};
      ++i;
    }
    if (std::abs(value) > std::abs(largest)) largest = value;
  }
  return largest;
}

/// Unit eigenvector by inverse iteration: two steps, since the eigenvalue is known to rounding.
Eigen::VectorXcd eigenvector(const MatrixXd& matrix, Complex value) {
  const Eigen::Index k = matrix.rows();
  const Complex shift = value * (1 + 1e-13) + 1e-300;  // keeps the factorisation regular
  Eigen::MatrixXcd shifted = matrix.cast<Complex>();
  shifted.diagonal().array() -= shift;
  const Eigen::PartialPivLU<Eigen::MatrixXcd> lu(shifted);
  Eigen::VectorXcd vector = Eigen::VectorXcd::Ones(k);
  for (int step = 0; step < 2; ++step) vector = lu.solve(vector).normalized();
  return vector;
}

/// Largest eigenvalue of the map and the mode part of its vector, by Arnoldi iteration. The
/// spectrum of a delay map crowds at zero, so a short Krylov space holds what matters.
struct Dominant {
  Complex value;
  Eigen::VectorXcd modes;
};

Dominant dominant_of(const ToothPassMap& map) {
  const auto n = static_cast<Eigen::Index>(map.size());
  const Eigen::Index states = 2 * static_cast<Eigen::Index>(map.modes().size());
  constexpr double kTolerance = 1e-9;
  const Eigen::Index most = std::min<Eigen::Index>(n, 400);
  Eigen::Index next_look = std::min<Eigen::Index>(most, std::max<Eigen::Index>(12, 2 * states));
  MatrixXd basis(n, std::min<Eigen::Index>(most, 32) + 1);
  MatrixXd hessenberg = MatrixXd::Zero(basis.cols(), basis.cols());
  // Any vector that favours nothing; always the same, so that results repeat bit for bit.
  for (Eigen::Index i = 0; i < n; ++i)
    basis(i, 0) = std::fmod(0.5 + 0.6180339887498949 * static_cast<double>(i), 1.0) - 0.25;
  basis.col(0).normalize();
  VectorXd image(n);
  for (Eigen::Index k = 1; k <= most; ++k) {
    if (k >= basis.cols()) {
      const Eigen::Index columns = std::min<Eigen::Index>(most, 2 * basis.cols()) + 1;
      basis.conservativeResize(Eigen::NoChange, columns);
      MatrixXd larger = MatrixXd::Zero(columns, columns);
      larger.topLeftCorner(hessenberg.rows(), hessenberg.cols()) = hessenberg;
      hessenberg.swap(larger);
    }
    map.apply(basis.col(k - 1).data(), image.data());
    for (int pass = 0; pass < 2; ++pass) {  // twice is enough for full orthogonality
      const VectorXd share = basis.leftCols(k).transpose() * image;
      image.noalias() -= basis.leftCols(k) * share;
      hessenberg.col(k - 1).head(k) += share;
    }
    const double rest = image.norm();
    hessenberg(k, k - 1) = rest;
    const bool closed = rest <= 1e-300;
    if (k < next_look && !closed && k < most) {
      basis.col(k) = image / rest;
      continue;
    }
    const MatrixXd small = hessenberg.topLeftCorner(k, k);
    const Complex value = largest_eigenvalue(small);
    const Eigen::VectorXcd weights = eigenvector(small, value);
    const double residual = rest * std::abs(weights[k - 1]);
    if (residual <= kTolerance * std::abs(value) || closed || k == most)
      return {value, basis.topLeftCorner(states, k) * weights};
    next_look = std::min<Eigen::Index>(most, k + std::max<Eigen::Index>(4, k / 3));
    basis.col(k) = image / rest;
  }
  return {};
}

}  // namespace

Expected<SemiDiscretization> SemiDiscretization::create(const Structure& structure,
                                                        const MillingTool& tool,
                                                        const MillingCut& cut,
                                                        const SemiDiscretizationConfig& config) {
  if (auto error = refuse_cut(tool, cut)) return *error;
  if (auto error = refuse_structure(structure)) return *error;
  if (config.hold_order < 1 || config.hold_order > kHighestOrder)
    return usage_error("The hold order must lie between 1 and " + std::to_string(kHighestOrder) +
                       ".");
  if (!(config.phase_per_interval_rad > 0 && config.phase_per_interval_rad <= kPi))
    return usage_error("The phase per interval must lie between 0 and pi.");
  return SemiDiscretization(structure, tool, cut, config);
}

SemiDiscretization::SemiDiscretization(const Structure& structure, const MillingTool& tool,
                                       const MillingCut& cut,
                                       const SemiDiscretizationConfig& config)
    : structure_(structure), tool_(tool), engagement_(engagement_of(tool, cut)), config_(config) {}

double SemiDiscretization::spectral_radius(double spindle_speed_rpm, double axial_depth_m) const {
  const ToothPassMap map(structure_, tool_, engagement_, config_, spindle_speed_rpm, axial_depth_m);
  return std::abs(dominant_of(map).value);
}

CriticalMultiplier SemiDiscretization::critical_multiplier(double spindle_speed_rpm,
                                                           double axial_depth_m) const {
  const ToothPassMap map(structure_, tool_, engagement_, config_, spindle_speed_rpm, axial_depth_m);
  Dominant dominant = dominant_of(map);
  // Which way the modes turn at the entry tells the multiplier of the positive frequencies from its
  // conjugate.
  double turn = 0;
  for (Eigen::Index m = 0; m < dominant.modes.size() / 2; ++m)
    turn += std::imag(std::conj(dominant.modes[2 * m]) * dominant.modes[2 * m + 1]);
  // A real multiplier has a real vector, which turns neither way.
  const bool real = std::abs(dominant.value.imag()) <= 1e-9 * std::abs(dominant.value);
  Complex rising = dominant.value;
  // The velocity leads a positive frequency by a quarter turn: q' = j w q.
  if (!real && turn < 0) rising = std::conj(rising);

  CriticalMultiplier result;
  result.multiplier = {dominant.value.real(), std::abs(dominant.value.imag())};
  if (real) result.loss = dominant.value.real() < 0 ? StabilityLoss::flip : StabilityLoss::fold;

  const double period = 60 / (tool_.teeth * spindle_speed_rpm);
  double highest = 0;
  for (const auto* modes : {&structure_.x, &structure_.y})
    for (const StructuralMode& m : *modes) highest = std::max(highest, m.natural_frequency_hz);
  double strongest = 0;
  const double base = std::arg(rising) / kTwoPi;
  for (int l = 0; (l - 1) / period < 2 * highest; ++l) {
    const double f = (base + l) / period;
    if (f <= 0) continue;
    double response = 0;
    for (const auto* modes : {&structure_.x, &structure_.y}) {
      Complex sum = 0;
      for (const StructuralMode& m : *modes) sum += m.receptance(kTwoPi * f);
      response = std::max(response, std::abs(sum));
    }
    if (response > strongest) {
      strongest = response;
      result.chatter_frequency_hz = f;
    }
  }
  return result;
}

LobePoint SemiDiscretization::limit_between(double spindle_speed_rpm, double stable_m,
                                            double unstable_m) const {
  const double depth =
      root_between([&](double a) { return spectral_radius(spindle_speed_rpm, a) - 1; }, stable_m,
                   unstable_m, 1e-6);
  return {spindle_speed_rpm, depth,
          critical_multiplier(spindle_speed_rpm, depth).chatter_frequency_hz};
}

LobePoint SemiDiscretization::limit_at(double spindle_speed_rpm, double deepest_m,
                                       int looks) const {
  double stable = 0;
  for (int i = 1; i <= looks; ++i) {
    const double depth = deepest_m * i / looks;
    if (spectral_radius(spindle_speed_rpm, depth) >= 1)
      return limit_between(spindle_speed_rpm, stable, depth);
    stable = depth;
  }
  return {spindle_speed_rpm, kInfinite, std::numeric_limits<double>::quiet_NaN()};
}

Expected<StabilityChart> SemiDiscretization::chart(std::span<const double> spindle_speed_rpm,
                                                   std::span<const double> axial_depth_m,
                                                   unsigned threads) const {
  if (auto error = refuse_axis(spindle_speed_rpm, "spindle speed", "rpm")) return *error;
  if (auto error = refuse_axis(axial_depth_m, "axial depth", "m")) return *error;
  if (!std::is_sorted(axial_depth_m.begin(), axial_depth_m.end()))
    return usage_error("The depths of a stability chart must rise.");
  const std::size_t speeds = spindle_speed_rpm.size();
  const std::size_t depths = axial_depth_m.size();
  StabilityChart chart;
  chart.spindle_speed_rpm.assign(spindle_speed_rpm.begin(), spindle_speed_rpm.end());
  chart.axial_depth_m.assign(axial_depth_m.begin(), axial_depth_m.end());
  chart.spectral_radius.resize(speeds * depths);
  chart.limit.resize(speeds);

  // Each speed is worked out whole by one thread, into its own place: the order does not matter.
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t s = next++; s < speeds; s = next++) {
      const double speed = spindle_speed_rpm[s];
      double* row = &chart.spectral_radius[s * depths];
      for (std::size_t d = 0; d < depths; ++d) row[d] = spectral_radius(speed, axial_depth_m[d]);
      const double* unstable = std::find_if(row, row + depths, [](double mu) { return mu >= 1; });
      const auto d = static_cast<std::size_t>(unstable - row);
      chart.limit[s] =
          d == depths ? LobePoint{speed, kInfinite, std::numeric_limits<double>::quiet_NaN()}
                      : limit_between(speed, d == 0 ? 0 : axial_depth_m[d - 1], axial_depth_m[d]);
    }
  };
  const unsigned cores = threads != 0 ? threads : std::max(1U, std::thread::hardware_concurrency());
  std::vector<std::thread> crew;
  for (unsigned i = 1; i < cores; ++i) crew.emplace_back(work);
  work();
  for (std::thread& t : crew) t.join();
  return chart;
}

}  // namespace servosense
