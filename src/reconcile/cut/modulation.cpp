#include "reconcile/cut/modulation.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "dsp/dense.hpp"
#include "reconcile/cut/workflow.hpp"
#include "reconcile/numerics/line_spectrum.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr std::size_t kLeastGains = 128;

void take_off_means(std::vector<ToothGain>& gains) {
  std::map<std::pair<std::size_t, bool>, std::pair<double, double>> sums;
  for (const ToothGain& g : gains) {
    auto& [sum, count] = sums[{g.kind, g.held_out}];
    sum += g.gain;
    ++count;
  }
  for (ToothGain& g : gains) {
    const auto& [sum, count] = sums[{g.kind, g.held_out}];
    g.gain -= sum / count;
  }
}

/// Mean square of a line of so many cycles a pass, of any phase.
double mean_square_at(const std::vector<ToothGain>& gains, bool held_out, double cycles) {
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  double count = 0;
  for (const ToothGain& g : gains) {
    if (g.held_out != held_out) continue;
    const double phase = kTwoPi * cycles * static_cast<double>(g.pass);
    const Eigen::Vector2d wave(std::cos(phase), std::sin(phase));
    normal += wave * wave.transpose();
    right += g.gain * wave;
    ++count;
  }
  if (!(normal.determinant() > 0)) return 0;
  return right.dot(dense::solve_symmetric(normal, right)) / count;
}

}  // namespace

std::optional<Modulation> find_modulation(std::vector<ToothGain> gains, int teeth, double least,
                                          const Criteria& criteria) {
  take_off_means(gains);
  std::vector<const ToothGain*> fitted;
  for (const ToothGain& g : gains)
    if (!g.held_out) fitted.push_back(&g);
  if (fitted.size() < kLeastGains) return std::nullopt;
  const long first = fitted.front()->pass, length = fitted.back()->pass - first + 1;
  // No gain where none was measured.
  const Eigen::Index size = transform_size(length, 256);
  Eigen::VectorXd signal = Eigen::VectorXd::Zero(size);
  for (const ToothGain* g : fitted) signal(g->pass - first) = g->gain;
  const double step = 1 / static_cast<double>(size),
               apart = criteria.line_distance / static_cast<double>(length);
  const std::optional<Eigen::Index> peak = peak_of(
      power_of(signal),
      [&](Eigen::Index k) {
        const double cycles = step * static_cast<double>(k), turns = cycles * teeth;
        return cycles * static_cast<double>(length) >= criteria.line_periods &&
               (std::abs(turns - std::round(turns)) >= apart * teeth || turns <= 0.5);
      },
      criteria);
  if (!peak) return std::nullopt;
  double cycles = step * static_cast<double>(*peak), square = 0;
  for (int k = -20; k <= 20; ++k) {
    const double near = step * (static_cast<double>(*peak) + 0.05 * k);
    const double its = mean_square_at(gains, false, near);
    if (its > square) {
      square = its;
      cycles = near;
    }
  }
  const double amplitude = std::sqrt(2 * square);
  if (amplitude < least || mean_square_at(gains, true, cycles) < criteria.line_held_share * square)
    return std::nullopt;
  return Modulation{1 / cycles, amplitude};
}

std::vector<ToothGain> CuttingWorkflow::tooth_gains(const CutFit& fit) const {
  const Column x = predicted(fit.state, false), y = predicted(fit.state, true);
  const auto teeth = static_cast<std::size_t>(data_.tool.teeth);
  std::vector<ToothGain> gains;
  double up = 0, down = 0;
  const auto close = [&] {
    if (!gains.empty()) gains.back().gain = down > 0 ? up / down : 0;
    up = down = 0;
  };
  std::size_t block = CutAverage::kNone;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (average_.block_of[i] == CutAverage::kNone) continue;
    const auto pass =
        static_cast<long>(std::floor(data_.angle_rad[i] / kTwoPi * static_cast<double>(teeth)));
    if (gains.empty() || gains.back().pass != pass || block != average_.block_of[i]) {
      close();
      block = average_.block_of[i];
      const CutBlock& its = average_.blocks[block];
      const auto tooth = static_cast<std::size_t>(
          pass - static_cast<long>(teeth) *
                     static_cast<long>(
                         std::floor(static_cast<double>(pass) / static_cast<double>(teeth))));
      gains.push_back({pass, its.level * teeth + tooth, its.held_out, 0});
    }
    up += x[i] * (data_.force_x_N[i] - x[i]) + y[i] * (data_.force_y_N[i] - y[i]);
    down += x[i] * x[i] + y[i] * y[i];
  }
  close();
  return gains;
}

/// Whether what a vibration would explain to this share is the whole force that rises and falls.
bool CuttingWorkflow::is_modulation(const CutTransients& transients, double share) const {
  return modulation_ &&
         transients.share_of_modulation(modulation_->passes / data_.tool.teeth) > share;
}

/// The floor is the scatter over turns: what does not turn with the tool raises it, and the cut
/// would be said to be at its floor.
void CuttingWorkflow::tell_what_is_unsteady(Report& report) {
  if (modulation_) {
    const double turns = modulation_->passes / data_.tool.teeth;
    const double hz = average_.levels.front().speed_rad_s / kTwoPi / turns;
    why_nothing_ = "the force rises and falls by " + printed(100 * modulation_->amplitude, 2) +
                   " % once in " + printed(turns, 3) + " turns (" + printed(hz, 3) +
                   " Hz): a line that goes with neither turn nor tooth";
  } else if (unsteady_N_ > criteria_.unsteady_force * average_.effort_N) {
    why_nothing_ = printed(unsteady_N_, 3) +
                   " N neither turn with the tool nor are noise, beside " +
                   printed(average_.effort_N, 3) +
                   " N that do: chatter, or a feed or depth that is not steady";
  } else {
    return;
  }
  unsteady_ = true;
  report.remarks.emplace_back(
      "the noise floor is the scatter over turns, and holds what does not turn with the tool");
}

}  // namespace servosense::reconcile
