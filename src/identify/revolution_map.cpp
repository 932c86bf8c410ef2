#include "revolution_map.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/core/units.hpp"
#include "servosense/identify/stability_lobes.hpp"

namespace servosense {
namespace {

constexpr double kPhasePerStep_rad = 0.1;  // of the fastest mode
constexpr double kStepsPerArc = 24;        // at least, of the engagement of a tooth
constexpr std::size_t kMostSlices = 64;    // of a helix over the depth

/// Angle from each tooth to the one ahead of it.
std::vector<double> gaps(const MillingTool& tool) {
  const auto n = static_cast<std::size_t>(tool.teeth);
  std::vector<double> gap(n, kTwoPi / static_cast<double>(n));
  if (tool.tooth_angle_rad.empty()) return gap;
  for (std::size_t j = 0; j < n; ++j) {
    gap[j] = kTwoPi;
    for (std::size_t k = 0; k < n; ++k) {
      if (k == j) continue;
      double ahead = std::fmod(tool.tooth_angle_rad[k] - tool.tooth_angle_rad[j], kTwoPi);
      if (ahead <= 0) ahead += kTwoPi;
      gap[j] = std::min(gap[j], ahead);
    }
  }
  return gap;
}

double angle_of(const MillingTool& tool, std::size_t tooth) {
  return tool.tooth_angle_rad.empty() ? kTwoPi * static_cast<double>(tooth) / tool.teeth
                                      : tool.tooth_angle_rad[tooth];
}

std::array<double, 4> inverse_of(const std::array<double, 4>& m) {
  const double det = m[0] * m[3] - m[1] * m[2];
  return {m[3] / det, -m[1] / det, -m[2] / det, m[0] / det};
}

/// Integral of n n^T, n = (sin, cos), between two angles.
std::array<double, 4> normal_square(double from, double to) {
  const double half = 0.5 * (to - from), s = 0.25 * (std::sin(2 * to) - std::sin(2 * from));
  const double cross = 0.25 * (std::cos(2 * from) - std::cos(2 * to));
  return {half - s, cross, cross, half + s};
}

}  // namespace

bool needs_revolution_map(const MillingTool& tool) {
  return tool.force.process_damping_N_per_m != 0 || tooth_off_pitch(tool);
}

RevolutionMap::RevolutionMap(const Structure& structure, const MillingTool& tool,
                             const Engagement& engagement, double spindle_speed_rpm,
                             double axial_depth_m) {
  double fastest = 0;
  for (const auto& [list, direction] : {std::pair{&structure.x, 0}, std::pair{&structure.y, 1}})
    for (const StructuralMode& m : *list) {
      modes_.push_back(
          {kTwoPi * m.natural_frequency_hz, m.damping_ratio, m.modal_mass_kg, direction});
      // Stiffened by the cut.
      const double cut = tool.force.tangential_coefficient_N_per_m2 *
                         (1 + tool.force.radial_ratio) * axial_depth_m * tool.teeth;
      fastest =
          std::max(fastest, std::sqrt(modes_.back().wn * modes_.back().wn + cut / m.modal_mass_kg));
    }
  const double revolution_s = 60 / spindle_speed_rpm;
  steps_ = static_cast<std::size_t>(
      std::ceil(std::max(fastest * revolution_s / kPhasePerStep_rad,
                         kStepsPerArc * kTwoPi / std::max(engagement.swept_rad(), 1e-3))));
  const double dt = revolution_s / static_cast<double>(steps_);
  const double width = kTwoPi / static_cast<double>(steps_);

  // Gauss-Legendre, four points on 0..1.
  constexpr std::array<double, 4> at = {0.0694318442029737, 0.3300094782075719, 0.6699905217924281,
                                        0.9305681557970263};
  constexpr std::array<double, 4> weight = {0.1739274225687269, 0.3260725774312731,
                                            0.3260725774312731, 0.1739274225687269};
  for (const Oscillator& mode : modes_) {
    Response r{mode.free(dt), 0, 0, 0, 0};
    for (std::size_t k = 0; k < at.size(); ++k) {
      const Oscillator::Free kick = mode.free((1 - at[k]) * dt);
      const double scale = mode.impulse() * weight[k] * dt;
      r.q_from_begin += scale * kick.qp * (1 - at[k]);
      r.q_from_end += scale * kick.qp * at[k];
      r.p_from_begin += scale * kick.pp * (1 - at[k]);
      r.p_from_end += scale * kick.pp * at[k];
    }
    response_.push_back(r);
  }

  const double lag = 2 * axial_depth_m * std::tan(rad_from_deg(tool.helix_deg)) / tool.diameter_m;
  const auto slices =
      std::clamp<std::size_t>(static_cast<std::size_t>(std::ceil(2 * lag / width)), 1, kMostSlices);
  const double half_depth_kt = 0.5 * axial_depth_m * tool.force.tangential_coefficient_N_per_m2 /
                               static_cast<double>(slices);
  const double cutting_speed = tool.radius_m() * kTwoPi / revolution_s;
  const double drag = axial_depth_m * tool.force.process_damping_N_per_m /
                      (cutting_speed * static_cast<double>(slices));
  damping_.assign(steps_, Matrix2{});
  const std::vector<double> gap = gaps(tool);
  for (std::size_t j = 0; j < gap.size(); ++j) {
    const double delay = gap[j] / width;  // in steps
    Tooth tooth;
    tooth.steps = static_cast<std::size_t>(delay);
    const double x = delay - static_cast<double>(tooth.steps);
    // Cubic through the deflections 1 step newer, at, 1 and 2 steps older than the whole delay.
    tooth.weight = {-x * (x - 1) * (x - 2) / 6, (x + 1) * (x - 1) * (x - 2) / 2,
                    -(x + 1) * x * (x - 2) / 2, (x + 1) * x * (x - 1) / 6};
    memory_ = std::max(memory_, tooth.steps + 4);
    tooth.stiffness.assign(steps_, Matrix2{});
    tooth.cuts.assign(steps_, false);
    for (std::size_t n = 0; n < steps_; ++n)
      for (std::size_t s = 0; s < slices; ++s) {
        const double lagging = lag * (static_cast<double>(s) + 0.5) / static_cast<double>(slices);
        double from =
            std::fmod(angle_of(tool, j) + width * static_cast<double>(n) - lagging, kTwoPi);
        if (from < 0) from += kTwoPi;
        if (from + width > kTwoPi) from -= kTwoPi;
        const double begin = std::clamp(from, engagement.start_rad, engagement.exit_rad);
        const double end = std::clamp(from + width, engagement.start_rad, engagement.exit_rad);
        if (!(end > begin)) continue;
        const DirectionalCoefficients a =
            engagement_integral({begin, end}, tool.force.radial_ratio);
        const double k = half_depth_kt / width;
        Matrix2& sum = tooth.stiffness[n];
        sum[0] += k * a.xx;
        sum[1] += k * a.xy;
        sum[2] += k * a.yx;
        sum[3] += k * a.yy;
        tooth.cuts[n] = true;
        const Matrix2 square = normal_square(begin, end);
        for (std::size_t i = 0; i < 4; ++i) damping_[n][i] -= drag / width * square[i];
      }
    teeth_.push_back(std::move(tooth));
  }

  // (I - Q K - P C) F = force without what F itself does to the end of the step.
  std::array<double, 2> q{}, v{};
  for (std::size_t m = 0; m < modes_.size(); ++m) {
    q[static_cast<std::size_t>(modes_[m].direction)] += response_[m].q_from_end;
    v[static_cast<std::size_t>(modes_[m].direction)] += response_[m].p_from_end * modes_[m].wn;
  }
  for (std::size_t n = 0; n < steps_; ++n) {
    Matrix2 k{};
    for (const Tooth& tooth : teeth_)
      for (std::size_t i = 0; i < 4; ++i) k[i] += tooth.stiffness[n][i];
    const Matrix2& c = damping_[n];
    solve_.push_back(inverse_of({1 - k[0] * q[0] - c[0] * v[0], -k[1] * q[1] - c[1] * v[1],
                                 -k[2] * q[0] - c[2] * v[0], 1 - k[3] * q[1] - c[3] * v[1]}));
  }
}

void RevolutionMap::apply(const double* before, double* after) const {
  const std::size_t states = 2 * modes_.size();
  std::vector<double> state(before, before + states);
  std::vector<double> past(before + states,
                           before + states + 2 * memory_);  // grows by a revolution
  past.resize(2 * (memory_ + steps_));
  const auto force_at = [&](std::size_t interval, std::size_t now, const double* u,
                            const double* v) {
    std::array<double, 2> force{};
    for (const Tooth& tooth : teeth_) {
      if (!tooth.cuts[interval]) continue;
      std::array<double, 2> chip = {u[0], u[1]};
      for (std::size_t w = 0; w < 4; ++w) {
        const double* old = &past[2 * (now + 1 - tooth.steps - w)];
        for (std::size_t d = 0; d < 2; ++d) chip[d] -= tooth.weight[w] * old[d];
      }
      const Matrix2& k = tooth.stiffness[interval];
      force[0] += k[0] * chip[0] + k[1] * chip[1];
      force[1] += k[2] * chip[0] + k[3] * chip[1];
    }
    const Matrix2& c = damping_[interval];
    force[0] += c[0] * v[0] + c[1] * v[1];
    force[1] += c[2] * v[0] + c[3] * v[1];
    return force;
  };
  const auto tip = [&](std::array<double, 2>& u, std::array<double, 2>& v) {
    u = v = {};
    for (std::size_t m = 0; m < modes_.size(); ++m) {
      const auto d = static_cast<std::size_t>(modes_[m].direction);
      u[d] += state[2 * m];
      v[d] += modes_[m].wn * state[2 * m + 1];
    }
  };
  std::array<double, 2> u{}, v{};
  for (std::size_t n = 0; n < steps_; ++n) {
    const std::size_t now = memory_ - 1 + n;  // place of the deflection at the step's begin
    tip(u, v);
    past[2 * now] = u[0];
    past[2 * now + 1] = u[1];
    const std::array<double, 2> first = force_at(n, now, u.data(), v.data());
    for (std::size_t m = 0; m < modes_.size(); ++m) {
      const auto d = static_cast<std::size_t>(modes_[m].direction);
      const Response& r = response_[m];
      const double q = state[2 * m], p = state[2 * m + 1];
      state[2 * m] = r.free.qq * q + r.free.qp * p + r.q_from_begin * first[d];
      state[2 * m + 1] = r.free.pq * q + r.free.pp * p + r.p_from_begin * first[d];
    }
    tip(u, v);
    const std::array<double, 2> rest = force_at(n, now + 1, u.data(), v.data());
    const Matrix2& inverse = solve_[n];
    const std::array<double, 2> last = {inverse[0] * rest[0] + inverse[1] * rest[1],
                                        inverse[2] * rest[0] + inverse[3] * rest[1]};
    for (std::size_t m = 0; m < modes_.size(); ++m) {
      const auto d = static_cast<std::size_t>(modes_[m].direction);
      state[2 * m] += response_[m].q_from_end * last[d];
      state[2 * m + 1] += response_[m].p_from_end * last[d];
    }
    tip(u, v);
    past[2 * (now + 1)] = u[0];
    past[2 * (now + 1) + 1] = u[1];
  }
  std::copy(state.begin(), state.end(), after);
  std::copy(past.end() - static_cast<long>(2 * memory_), past.end(), after + states);
}

}  // namespace servosense
