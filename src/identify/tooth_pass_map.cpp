#include "tooth_pass_map.hpp"

#include <algorithm>

namespace servosense {
namespace {

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

}  // namespace

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
      std::array<double, kHighestHoldOrder + 1> held{};
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
      double force[(kHighestHoldOrder + 1) * 2];  // [node][direction]
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
      double known[kHighestHoldOrder * 2];
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
      double change[kHighestHoldOrder * 2];
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

}  // namespace servosense
