// Vibration over time: modes of the tool, where it is and where it was a tooth ago, led by the
// model's forces or by those measured; and a sensor that rings.
#include <algorithm>
#include <cmath>
#include <limits>

#include "dsp/dense.hpp"
#include "reconcile/cut/oscillator.hpp"
#include "reconcile/cut/transients.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kStepsATurn = 360, kStepsAPeriod = 24;
constexpr double kFiner = 4;  // a late force damps or drives: near the limit of stability it counts
constexpr double kWarmUpTurns = 3, kWarmUpDecays = 6;
constexpr double kFurthest_m = 1e-3;  // what moves further does not cut like this
constexpr double kRanAway_N = 1e60;   // more than any fit would take

std::vector<CutTransients::Mode> modes_of(const Structure& structure) {
  std::vector<CutTransients::Mode> modes;
  for (const StructuralMode& m : structure.x) modes.push_back({0, m, false});
  for (const StructuralMode& m : structure.y) modes.push_back({1, m, false});
  return modes;
}

}  // namespace

/// The tool on its modes, and where it has been.
class CutTransients::Tool {
 public:
  /// By where the tool is, along x and y; by where it was a tooth ago.
  using Forces = std::array<double, 4>;
  struct Mark {
    std::vector<Oscillator> modes;
    std::array<double, 2> displacement_m{};
    std::size_t at = 0;
  };

  /// Remembered for `longest_s`, and for as many steps more as `back_to` goes.
  Tool(const std::vector<Mode>& modes, double step_s, double longest_s, int steps_back)
      : step_s_(step_s),
        past_m_(
            static_cast<std::size_t>(longest_s / step_s) + 4 + static_cast<std::size_t>(steps_back),
            {0, 0}) {
    for (const Mode& m : modes) {
      axis_.push_back(m.axis);
      modes_.emplace_back(m.mode, step_s);
    }
  }

  /// On the tool, at an angle of the grid.
  Forces forces(const Level& l, Eigen::Index g) {
    if (&l != level_) go_to(l);
    past_m_[at_] = displacement_m_;
    Forces now{};
    for (std::size_t m = 0; m < back_.size(); ++m) {
      const std::array<double, 4>& c = l.memories[m].N_per_m[static_cast<std::size_t>(g)];
      const std::array<double, 2> then = displacement_before(back_[m]);
      for (std::size_t a = 0; a < 2; ++a)
        for (std::size_t f = 0; f < 2; ++f) {
          now[f] += c[2 * a + f] * displacement_m_[a];
          now[2 + f] -= c[2 * a + f] * then[a];
        }
    }
    return now;
  }
  void step(const std::array<double, 2>& force_N) {
    past_m_[at_] = displacement_m_;
    displacement_m_ = {};
    for (std::size_t m = 0; m < modes_.size(); ++m)
      displacement_m_[axis_[m]] += modes_[m].step(force_N[axis_[m]]);
    at_ = at_ + 1 == past_m_.size() ? 0 : at_ + 1;
  }
  [[nodiscard]] bool cuts() const {
    return std::abs(displacement_m_[0]) < kFurthest_m && std::abs(displacement_m_[1]) < kFurthest_m;
  }
  [[nodiscard]] Mark mark() const { return {modes_, displacement_m_, at_}; }
  void back_to(const Mark& mark) {
    modes_ = mark.modes;
    displacement_m_ = mark.displacement_m;
    at_ = mark.at;
  }

  /// Along x and y.
  [[nodiscard]] const std::array<double, 2>& displacement_m() const { return displacement_m_; }

 private:
  /// A time ago, in steps.
  struct Back {
    std::size_t whole = 0;
    double part = 0;
  };

  void go_to(const Level& l) {
    level_ = &l;
    back_.clear();
    for (const Level::Memory& m : l.memories) {
      const double steps =
          m.back * kTwoPi / static_cast<double>(kCutGrid) / l.speed_rad_s / step_s_;
      const auto whole = static_cast<std::size_t>(steps);
      back_.push_back({whole, steps - static_cast<double>(whole)});
    }
  }

  [[nodiscard]] std::array<double, 2> displacement_before(const Back& back) const {
    const std::size_t near =
        at_ >= back.whole ? at_ - back.whole : at_ + past_m_.size() - back.whole;
    const std::size_t far = near > 0 ? near - 1 : past_m_.size() - 1;
    std::array<double, 2> u{};
    for (std::size_t a = 0; a < 2; ++a)
      u[a] = past_m_[near][a] + back.part * (past_m_[far][a] - past_m_[near][a]);
    return u;
  }

  double step_s_;
  const Level* level_ = nullptr;
  std::vector<Back> back_;  ///< of its memories
  std::array<double, 2> displacement_m_{};
  std::vector<std::size_t> axis_;
  std::vector<Oscillator> modes_;
  std::vector<std::array<double, 2>> past_m_;  ///< a ring
  std::size_t at_ = 0;
};

double CutTransients::longest_memory_s() const {
  double longest = 0;
  for (const Level& l : levels_)
    for (const Level::Memory& m : l.memories)
      longest = std::max(longest, m.back * kTwoPi / static_cast<double>(kCutGrid) / l.speed_rad_s);
  return longest;
}

/// Share of this level in the force, so far into it.
double CutTransients::Level::share_after(double turned_rad, Start start) const {
  if (!start.gradual) return 1;
  double tooth_rad = kTwoPi;
  for (const Memory& m : memories)
    tooth_rad = std::min(tooth_rad, m.back * kTwoPi / static_cast<double>(kCutGrid));
  return std::min(1.0, turned_rad / tooth_rad);
}

/// Steps of a simulation within one sample.
int CutTransients::steps_a_sample(const std::vector<Mode>& modes, Excitation by) const {
  const double turn_of_sample = levels_[passes_.front().level].speed_rad_s * step_s_;
  double parts = turn_of_sample / kTwoPi * kStepsATurn;
  if (!by.measured)
    for (const Mode& m : modes)
      parts = std::max(parts, step_s_ * m.mode.natural_frequency_hz * kStepsAPeriod *
                                  (by.start.fine ? kFiner : 1));
  return std::max(2, static_cast<int>(std::ceil(parts)));
}

CutTransients::Vibration CutTransients::vibration(const std::vector<Mode>& modes,
                                                  Excitation by) const {
  const std::size_t n = scored_.size();
  const Level& first = levels_[passes_.front().level];
  const double turn_of_sample = first.speed_rad_s * step_s_;
  const int parts = steps_a_sample(modes, by);
  Tool tool(modes, step_s_ / parts, longest_memory_s(), parts);
  // Led by the model; means over the sample.
  const auto sample = [&](const Level& l, const Level& old, double new_part, double angle,
                          double turned) {
    Tool::Forces mean{};
    const double share = 1.0 / parts;
    for (int k = 0; k < parts; ++k) {
      const Eigen::Index g =
          grid_index(angle + turned * ((static_cast<double>(k) + 0.5) * share - 0.5));
      const Tool::Forces now = tool.forces(l, g);
      for (std::size_t f = 0; f < 4; ++f) mean[f] += share * now[f];
      std::array<double, 2> force_N{};
      for (std::size_t a = 0; a < 2; ++a)
        force_N[a] = new_part * l.rigid_N[a](g) + (1 - new_part) * old.rigid_N[a](g) + now[a] +
                     (by.remembers ? now[2 + a] : 0);
      tool.step(force_N);
    }
    return mean;
  };
  if (!by.measured && !by.start.from_rest)
    for (int i = static_cast<int>(kWarmUpTurns * kTwoPi / turn_of_sample); i > 0; --i)
      sample(first, first, 1, angle_rad_.front() - i * turn_of_sample, turn_of_sample);
  const auto size = static_cast<Eigen::Index>(2 * n);
  Vibration out{Eigen::VectorXd::Zero(size), Eigen::VectorXd::Zero(size)};
  for (std::size_t p = 0; p < passes_.size(); ++p) {
    const Pass& pass = passes_[p];
    const Level& l = levels_[pass.level];
    const Level& old = levels_[passes_[p > 0 ? p - 1 : 0].level];
    const double turned = l.speed_rad_s * step_s_;
    for (std::size_t i = pass.first; i < pass.last; ++i) {
      const double there = l.share_after(static_cast<double>(i - pass.first) * turned, by.start);
      const Tool::Mark before = tool.mark();
      const Tool::Forces mean = sample(l, old, there, angle_rad_[i], turned);
      if (!by.measured && !tool.cuts())
        return {Eigen::VectorXd::Constant(size, kRanAway_N), Eigen::VectorXd::Zero(size)};
      for (std::size_t f = 0; f < 2; ++f) {
        out.now(static_cast<Eigen::Index>(f * n + i)) = mean[f];
        out.before(static_cast<Eigen::Index>(f * n + i)) = mean[2 + f];
      }
      if (!by.measured) continue;
      // Within the sample the tool answers the model, and only then what was measured: else noise
      // would call up what it is compared with.
      tool.back_to(before);
      for (int k = 0; k < parts; ++k) tool.step({force_N_[0][i], force_N_[1][i]});
    }
  }
  take_off_means(out.now);
  take_off_means(out.before);
  return out;
}

/// What a sensor that rings adds. Of a steady cut it falls within the bins of the means, where a
/// model is not exact: only what differs from it counts.
Eigen::VectorXd CutTransients::ringing(const Mode& sensor, Start start) const {
  const std::size_t n = scored_.size(), axis = sensor.axis;
  const int parts = steps_a_sample({sensor}, {false, false, start});
  const Oscillator at_rest(sensor.mode, step_s_ / parts);
  const double stiffness_N_per_m = sensor.mode.stiffness_N_per_m();
  const double decay_s = 1 / (sensor.mode.damping_ratio * sensor.mode.natural_frequency_rad_s());
  const auto index_at = [&](double angle, double turned, int k) {
    return grid_index(angle + turned * ((static_cast<double>(k) + 0.5) / parts - 0.5));
  };
  const auto settled = [&](const Pass& pass) {
    Oscillator steady = at_rest;
    const Level& l = levels_[pass.level];
    const double turned = l.speed_rad_s * step_s_;
    const double samples =
        std::min(kWarmUpDecays * decay_s / step_s_, static_cast<double>(pass.last - pass.first));
    for (int i = static_cast<int>(samples); i > 0; --i)
      for (int k = 0; k < parts; ++k)
        steady.step(l.rigid_N[axis](index_at(angle_rad_[pass.first] - i * turned, turned, k)));
    return steady;
  };
  Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(2 * n));
  Oscillator oscillator = start.from_rest ? at_rest : settled(passes_.front());
  for (std::size_t p = 0; p < passes_.size(); ++p) {
    const Pass& pass = passes_[p];
    const Level& l = levels_[pass.level];
    const Level& before = levels_[passes_[p > 0 ? p - 1 : 0].level];
    Oscillator steady = settled(pass);
    const double turned = l.speed_rad_s * step_s_;
    for (std::size_t i = pass.first; i < pass.last; ++i) {
      const double there = l.share_after(static_cast<double>(i - pass.first) * turned, start);
      double sum = 0;
      for (int k = 0; k < parts; ++k) {
        const Eigen::Index g = index_at(angle_rad_[i], turned, k);
        const double now = l.rigid_N[axis](g);
        const double rigid = there * now + (1 - there) * before.rigid_N[axis](g);
        sum += (oscillator.step(rigid) - steady.step(now)) * stiffness_N_per_m - (rigid - now);
      }
      out(static_cast<Eigen::Index>(axis * n + i)) = sum / parts;
    }
  }
  take_off_means(out);
  return out;
}

Eigen::VectorXd CutTransients::simulated(const Mode& mode, Start start) const {
  if (mode.of_sensor) return ringing(mode, start);
  const Vibration v = vibration({mode}, {mode.driven, true, start});
  return v.now + v.before;
}

Eigen::VectorXd CutTransients::simulated(const Structure& structure, Start start,
                                         bool remembers) const {
  const Vibration v = vibration(modes_of(structure), {false, remembers, start});
  return remembers ? Eigen::VectorXd(v.now + v.before) : v.now;
}

CutTransients::Judged CutTransients::judged_beside(const Eigen::VectorXd& without,
                                                   const Eigen::VectorXd& with) const {
  return judged({}, {}, with - without, measured_ - without);
}

double CutTransients::fading(const Mode& mode) const {
  double least = std::numeric_limits<double>::infinity();
  for (const Level& l : levels_) {
    const int turns = std::max(2, static_cast<int>(shortest_s_ * l.speed_rad_s / kTwoPi));
    Tool tool({mode}, kTwoPi / static_cast<double>(kCutGrid) / l.speed_rad_s, longest_memory_s(),
              0);
    std::array<double, 2> largest{};  // in the first turn and in the last
    std::array<double, 2> push{};     // out of rest
    push[mode.axis] = mode.mode.stiffness_N_per_m();
    for (int turn = 0; turn < turns; ++turn)
      for (Eigen::Index g = 0; g < kCutGrid; ++g) {
        const Tool::Forces now = tool.forces(l, g);
        tool.step({push[0] + now[0] + now[2], push[1] + now[1] + now[3]});
        push = {};
        const double u = std::abs(tool.displacement_m()[mode.axis]);
        if (turn == 0) largest[0] = std::max(largest[0], u);
        if (turn + 1 == turns) largest[1] = std::max(largest[1], u);
      }
    least = std::min(least, std::log(largest[0] / std::max(1e-300, largest[1])));
  }
  return least;
}

CutTransients::JudgedMemory CutTransients::memory_of(const Structure& structure) const {
  const Vibration l = vibration(modes_of(structure), {true, true, {}});
  const auto rows = static_cast<Eigen::Index>(scored_.size());
  struct Sums {
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    double square = 0, count = 0;
    [[nodiscard]] Memory solved() const {
      const Eigen::Vector2d s = dense::solve_symmetric(normal, right);
      const double rest = square - right.dot(s);
      const Eigen::Vector2d e =
          (normal.inverse().diagonal() * rest / std::max(1.0, count)).cwiseMax(0.0).cwiseSqrt();
      return {s(0), s(1), e(0), e(1)};
    }
    [[nodiscard]] double left(const Eigen::Vector2d& s) const {
      return square - 2 * right.dot(s) + s.dot(normal * s);
    }
  };
  std::array<Sums, 2> of_part;
  JudgedMemory j;
  for (const Pass& pass : passes_) {
    Sums of_pass;
    for (std::size_t i = pass.first; i < pass.last; ++i)
      for (const Eigen::Index from : {Eigen::Index{0}, rows}) {
        if (scored_[i] == 0) continue;
        const Eigen::Index row = from + static_cast<Eigen::Index>(i);
        const Eigen::Vector2d v(l.now(row), l.before(row));
        for (Sums* sums : {&of_pass, &of_part[scored_[i] == 1 ? 0 : 1]}) {
          sums->normal += v * v.transpose();
          sums->right += v * measured_(row);
          sums->square += measured_(row) * measured_(row);
          ++sums->count;
        }
      }
    if (of_pass.count > 0) j.of_pass.push_back(of_pass.solved());
  }
  j.all = of_part[0].solved();
  const double alone = of_part[0].right(0) / std::max(1e-300, of_part[0].normal(0, 0));
  for (const auto& [sums, out] :
       {std::pair{&of_part[0], &j.fitted}, std::pair{&of_part[1], &j.held}})
    *out = {sums->square, sums->left({alone, 0}), sums->left({j.all.now, j.all.before})};
  return j;
}

}  // namespace servosense::reconcile
