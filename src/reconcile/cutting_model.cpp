#include "cutting_model.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <unsupported/Eigen/FFT>

#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kCurvePoints = 360;     // over the engagement; linear between them
constexpr Eigen::Index kGrid = 1024;  // angles of a revolution where dynamics are taken
constexpr double kSettled = 1e-7;     // of force and displacement on each other
constexpr int kLayers = 8;            // of a helix, where the chip follows the structure

double pitch_angle(const MillingTool& tool, std::size_t tooth) {
  return tool.tooth_angle_rad.empty()
             ? kTwoPi * static_cast<double>(tooth) / static_cast<double>(tool.teeth)
             : tool.tooth_angle_rad[tooth];
}

/// Part of the depth, from `low` to `high`, in which the same teeth still have their edge.
struct Zone {
  double low = 0, high = 0;  // of the depth
  std::vector<std::size_t> teeth;
};

std::vector<Zone> zones_of(const MillingTool& tool) {
  std::vector<double> ends = {0, 1};
  for (const double f : tool.broken_fraction) ends.push_back(std::clamp(f, 0.0, 1.0));
  std::sort(ends.begin(), ends.end());
  std::vector<Zone> zones;
  for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
    if (!(ends[i + 1] > ends[i])) continue;
    Zone zone{ends[i], ends[i + 1], {}};
    for (std::size_t j = 0; j < static_cast<std::size_t>(tool.teeth); ++j)
      if (tool.broken_fraction.empty() || tool.broken_fraction[j] <= ends[i])
        zone.teeth.push_back(j);
    zones.push_back(std::move(zone));
  }
  return zones;
}

/// Chip of one tooth among those of a zone.
class Chip {
 public:
  Chip(const CutState& state, const Zone& zone, std::size_t tooth, double feed_per_tooth_m)
      : radius_m_(state.tool.radius_m()),
        feed_per_rad_m_(feed_per_tooth_m * state.tool.teeth / kTwoPi) {
    const MillingTool& tool = state.tool;
    const auto thrown = [&](std::size_t j) { return tool.throw_m.empty() ? 0 : tool.throw_m[j]; };
    const double own = pitch_angle(tool, tooth);
    // Two turns back: a tooth that reaches less than that never cuts.
    for (const std::size_t other : zone.teeth)
      for (int turn = 0; turn < 2; ++turn) {
        double ahead = pitch_angle(tool, other) - own;
        ahead -= kTwoPi * std::floor(ahead / kTwoPi);
        if (other == tooth) ahead = kTwoPi;
        earlier_.push_back(
            {feed_per_rad_m_ * (ahead + kTwoPi * turn), thrown(tooth) - thrown(other)});
      }
  }

  [[nodiscard]] double thickness_m(double theta_rad) const {
    const double s = std::sin(theta_rad), c = std::cos(theta_rad);
    double least = earlier_.empty() ? 0 : 1e9;
    for (const auto& [since, reach] : earlier_) {
      const double h =
          since * s + reach + since * c / radius_m_ * (0.5 * since * c - feed_per_rad_m_ * s);
      least = std::min(least, h);
    }
    return std::max(0.0, least);
  }

 private:
  struct Earlier {
    double since_m, reach_m;
  };
  double radius_m_, feed_per_rad_m_;
  std::vector<Earlier> earlier_;
};

using Eight = Eigen::Array<double, 8, 1>;

/// Force per depth of one tooth over its angle: x and y of Kt, Kr, Kte, Kre. Kept as its first and
/// second integral, which is all that is ever asked for.
class ToothCurve {
 public:
  ToothCurve(const CutState& state, const Engagement& arc, const Chip& chip)
      : start_(arc.start_rad), step_(arc.swept_rad() / kCurvePoints) {
    const CuttingForceLaw& law = state.tool.force;
    Eight before;
    once_[0].setZero();
    twice_[0].setZero();
    for (int k = 0; k <= kCurvePoints; ++k) {
      const double theta = start_ + k * step_;
      const double h = chip.thickness_m(theta);
      double area = h;
      if (law.size_effect_exponent != 0 && h > 0)
        area *= std::pow(h / law.size_effect_reference_m, -law.size_effect_exponent);
      const double edge = h > 0 ? 1 : 0;
      const double s = std::sin(theta), c = std::cos(theta);
      Eight now;
      now << -area * c, area * s, -area * s, -area * c, -edge * c, edge * s, -edge * s, -edge * c;
      if (k > 0) {
        const auto i = static_cast<std::size_t>(k);
        once_[i] = once_[i - 1] + 0.5 * step_ * (before + now);
        twice_[i] = twice_[i - 1] + 0.5 * step_ * (once_[i - 1] + once_[i]);
      }
      before = now;
    }
  }

  [[nodiscard]] double end() const { return start_ + kCurvePoints * step_; }
  [[nodiscard]] double start() const { return start_; }

  [[nodiscard]] Eight once(double theta) const {
    const double x = (theta - start_) / step_;
    if (x <= 0) return Eight::Zero();
    if (x >= kCurvePoints) return once_[kCurvePoints];
    const auto k = static_cast<std::size_t>(x);
    const double part = x - static_cast<double>(k);
    return once_[k] + part * (once_[k + 1] - once_[k]);
  }
  [[nodiscard]] Eight twice(double theta) const {
    const double x = (theta - start_) / step_;
    if (x <= 0) return Eight::Zero();
    if (x >= kCurvePoints) return twice_[kCurvePoints] + (theta - end()) * once_[kCurvePoints];
    const auto k = static_cast<std::size_t>(x);
    const double part = x - static_cast<double>(k), d = part * step_;
    return twice_[k] + d * once_[k] + 0.5 * d * part * (once_[k + 1] - once_[k]);
  }

 private:
  double start_, step_;
  std::array<Eight, kCurvePoints + 1> once_, twice_;
};

double total_lag(const CutState& state) {
  return state.lag_scale * state.cut.axial_depth_m * std::tan(rad_from_deg(state.tool.helix_deg)) /
         state.tool.radius_m();
}

/// Rigid tool, force on the tool.
Eigen::MatrixXd rigid_columns(const CutState& state, double feed_per_tooth_m,
                              std::span<const double> angles_rad) {
  const auto n = static_cast<Eigen::Index>(angles_rad.size());
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(2 * n, state.columns());
  const Engagement arc = engagement_of(state);
  const double lag = total_lag(state);
  const double blur = std::max(1e-6, state.blur_rad);
  for (const Zone& zone : zones_of(state.tool)) {
    const double low = lag * zone.low, high = lag * zone.high;
    for (const std::size_t tooth : zone.teeth) {
      const ToothCurve curve(state, arc, Chip(state, zone, tooth, feed_per_tooth_m));
      const double ahead = pitch_angle(state.tool, tooth) + state.zero_rad;
      for (Eigen::Index i = 0; i < n; ++i) {
        double tip = angles_rad[static_cast<std::size_t>(i)] + ahead;
        tip -= kTwoPi * std::floor(tip / kTwoPi);
        Eight force = Eight::Zero();
        for (double turn = -kTwoPi; turn < 7; turn += kTwoPi) {
          const double at = tip + turn;
          const double first = at - std::max(low, high) - blur / 2;
          const double last = at - std::min(low, high) + blur / 2;
          if (last <= curve.start() || first >= curve.end()) continue;
          if (std::abs(high - low) < 1e-4) {
            const double middle = at - (low + high) / 2;
            force += (curve.once(middle + blur / 2) - curve.once(middle - blur / 2)) *
                     ((zone.high - zone.low) / blur);
          } else {
            force += (curve.twice(at - low + blur / 2) - curve.twice(at - low - blur / 2) -
                      curve.twice(at - high + blur / 2) + curve.twice(at - high - blur / 2)) *
                     ((zone.high - zone.low) / ((high - low) * blur));
          }
        }
        for (Eigen::Index c = 0; c < out.cols(); ++c) {
          out(i, c) += force(2 * c);
          out(n + i, c) += force(2 * c + 1);
        }
      }
    }
  }
  return out * state.cut.axial_depth_m;
}

/// Where layers of teeth are in the cut, over the grid: geometry alone.
struct Contact {
  Eigen::Index at = 0;
  double back = 0;  // grid steps to where the tooth before was here
  double sine = 0, cosine = 0, depth_m = 0;
};

std::vector<Contact> contacts_of(const CutState& state, double feed_per_tooth_m) {
  std::vector<Contact> contacts;
  const Engagement arc = engagement_of(state);
  const double lag = total_lag(state);
  for (const Zone& zone : zones_of(state.tool)) {
    const double share = zone.high - zone.low;
    const int layers = lag == 0 ? 1 : std::max(1, static_cast<int>(std::lround(kLayers * share)));
    for (const std::size_t tooth : zone.teeth) {
      const Chip chip(state, zone, tooth, feed_per_tooth_m);
      const double own = pitch_angle(state.tool, tooth);
      double before = kTwoPi;
      for (const std::size_t other : zone.teeth) {
        double ahead = pitch_angle(state.tool, other) - own;
        ahead -= kTwoPi * std::floor(ahead / kTwoPi);
        if (other != tooth && ahead > 0) before = std::min(before, ahead);
      }
      for (Eigen::Index i = 0; i < kGrid; ++i)
        for (int layer = 0; layer < layers; ++layer) {
          const double height = zone.low + share * (layer + 0.5) / layers;
          double theta = kTwoPi * static_cast<double>(i) / static_cast<double>(kGrid) + own +
                         state.zero_rad - lag * height;
          theta -= kTwoPi * std::floor((theta - arc.start_rad) / kTwoPi);
          if (theta > arc.exit_rad || !(chip.thickness_m(theta) > 0)) continue;
          contacts.push_back({i, before / kTwoPi * static_cast<double>(kGrid), std::sin(theta),
                              std::cos(theta), state.cut.axial_depth_m * share / layers});
        }
    }
  }
  return contacts;
}

/// What a vibration adds to the chips: Kt and Kr columns over the grid.
Eigen::MatrixXd vibration_columns(const std::vector<Contact>& contacts, const Eigen::VectorXd& x,
                                  const Eigen::VectorXd& y) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(2 * kGrid, 2);
  for (const Contact& c : contacts) {
    double g = static_cast<double>(c.at) - c.back;
    if (g < 0) g += static_cast<double>(kGrid);
    const auto k = std::min(static_cast<Eigen::Index>(g), kGrid - 1);
    const Eigen::Index next = k + 1 == kGrid ? 0 : k + 1;
    const double part = g - static_cast<double>(k);
    const double dx = x(c.at) - x(k) - part * (x(next) - x(k));
    const double dy = y(c.at) - y(k) - part * (y(next) - y(k));
    const double thicker = (dx * c.sine + dy * c.cosine) * c.depth_m;
    out(c.at, 0) -= thicker * c.cosine;
    out(kGrid + c.at, 0) += thicker * c.sine;
    out(c.at, 1) -= thicker * c.sine;
    out(kGrid + c.at, 1) -= thicker * c.cosine;
  }
  return out;
}

/// Force of process damping on the tool, x then y: against the speed normal to the surface, per
/// cutting speed.
Eigen::VectorXd damping_force(const std::vector<Contact>& contacts, double coefficient_s_N_per_m2,
                              const Eigen::VectorXd& vx, const Eigen::VectorXd& vy) {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(2 * kGrid);
  for (const Contact& c : contacts) {
    const double radial =
        coefficient_s_N_per_m2 * c.depth_m * (vx(c.at) * c.sine + vy(c.at) * c.cosine);
    out(c.at) -= radial * c.sine;
    out(kGrid + c.at) -= radial * c.cosine;
  }
  return out;
}

/// Periodic signal through a frequency response.
template <typename Response>
Eigen::VectorXd filtered(const Eigen::VectorXd& signal, double speed_rad_s, Response response) {
  thread_local Eigen::FFT<double> fft;  // keeps its tables
  Eigen::VectorXcd spectrum;
  fft.fwd(spectrum, signal);
  const Eigen::Index n = signal.size();
  for (Eigen::Index k = 0; k <= n / 2; ++k) {
    spectrum(k) *= response(speed_rad_s * static_cast<double>(k));
    if (k > 0) spectrum(n - k) = std::conj(spectrum(k));
  }
  Eigen::VectorXd out(n);
  fft.inv(out, spectrum);
  return out;
}

std::complex<double> receptance(const std::vector<StructuralMode>& modes, double frequency_rad_s) {
  std::complex<double> sum = 0;
  for (const StructuralMode& mode : modes) sum += mode.receptance(frequency_rad_s);
  return sum;
}

}  // namespace

Engagement engagement_of(const CutState& state) {
  MillingCut cut = state.cut;
  cut.radial_immersion_m *= state.immersion_scale;
  return servosense::engagement_of(state.tool, cut);
}

Eigen::MatrixXd force_columns(const CutState& state, double feed_per_tooth_m, double speed_rad_s,
                              std::span<const double> angles_rad) {
  const bool gives = !state.structure.x.empty() || !state.structure.y.empty();
  const auto n = static_cast<Eigen::Index>(angles_rad.size());
  Eigen::MatrixXd out;
  if (!gives && !state.sensor) {
    out = rigid_columns(state, feed_per_tooth_m, angles_rad);
  } else {
    std::vector<double> grid;
    for (Eigen::Index i = 0; i < kGrid; ++i)
      grid.push_back(kTwoPi * static_cast<double>(i) / static_cast<double>(kGrid));
    // Means over the steps of the grid: a tooth that enters between two of them rings as early as
    // it should.
    CutState smooth = state;
    smooth.blur_rad = std::max(state.blur_rad, kTwoPi / static_cast<double>(kGrid));
    const Eigen::MatrixXd rigid = rigid_columns(smooth, feed_per_tooth_m, grid);
    Eigen::MatrixXd columns = rigid;
    if (gives) {
      const Eigen::Map<const Eigen::Vector4d> all(state.coefficients.data());
      const Eigen::VectorXd k = all.head(state.columns());
      const std::vector<Contact> contacts = contacts_of(state, feed_per_tooth_m);
      const double damping = state.tool.force.process_damping_N_per_m /
                             std::max(1e-9, speed_rad_s * state.tool.radius_m());
      // Its mean over a turn belongs to the structure; only the rest is settled round by round,
      // which would run away with all of it.
      double mean_x = 0, mean_y = 0;
      for (const Contact& c : contacts) {
        mean_x += damping * c.depth_m * c.sine * c.sine / static_cast<double>(kGrid);
        mean_y += damping * c.depth_m * c.cosine * c.cosine / static_cast<double>(kGrid);
      }
      Eigen::VectorXd damped = Eigen::VectorXd::Zero(2 * kGrid), held_by_mean = damped;
      for (int round = 0; round < state.vibration_rounds; ++round) {
        const Eigen::VectorXd force = columns * k + held_by_mean;
        const auto moved = [&](Eigen::Index from, const std::vector<StructuralMode>& modes,
                               double mean, bool speed) {
          return filtered(force.segment(from, kGrid), speed_rad_s, [&](double w) {
            const std::complex<double> g = receptance(modes, w), iw(0, w);
            return g / (1.0 + iw * mean * g) * (speed ? iw : 1.0);
          });
        };
        const Eigen::VectorXd x = moved(0, state.structure.x, mean_x, false);
        const Eigen::VectorXd y = moved(kGrid, state.structure.y, mean_y, false);
        const Eigen::MatrixXd before = columns.leftCols(2);
        columns.leftCols(2) = rigid.leftCols(2) + vibration_columns(contacts, x, y);
        if (damping == 0 && (columns.leftCols(2) - before).norm() < kSettled * before.norm()) break;
        if (damping == 0 || !(std::abs(k(0)) > 0)) continue;
        const Eigen::VectorXd vx = moved(0, state.structure.x, mean_x, true);
        const Eigen::VectorXd vy = moved(kGrid, state.structure.y, mean_y, true);
        damped = damping_force(contacts, damping, vx, vy);
        held_by_mean.head(kGrid) = mean_x * vx;
        held_by_mean.tail(kGrid) = mean_y * vy;
        columns.col(0) += damped / k(0);
      }
    }
    for (std::size_t axis = 0; axis < 2 && state.sensor; ++axis) {
      const StructuralMode unit{state.sensor->natural_frequency_hz[axis],
                                state.sensor->damping_ratio[axis], 1};
      const double stiffness = unit.stiffness_N_per_m();
      const Eigen::Index from = axis == 0 ? 0 : kGrid;
      for (Eigen::Index c = 0; c < columns.cols(); ++c)
        columns.col(c).segment(from, kGrid) =
            filtered(columns.col(c).segment(from, kGrid), speed_rad_s,
                     [&](double w) { return stiffness * unit.receptance(w); });
    }
    out.resize(2 * n, columns.cols());
    for (Eigen::Index i = 0; i < n; ++i) {
      double g = angles_rad[static_cast<std::size_t>(i)] / kTwoPi * static_cast<double>(kGrid);
      g -= static_cast<double>(kGrid) * std::floor(g / static_cast<double>(kGrid));
      const auto k = std::min(static_cast<Eigen::Index>(g), kGrid - 1);
      const Eigen::Index next = (k + 1) % kGrid;
      const double part = g - static_cast<double>(k);
      out.row(i) = (1 - part) * columns.row(k) + part * columns.row(next);
      out.row(n + i) = (1 - part) * columns.row(kGrid + k) + part * columns.row(kGrid + next);
    }
  }
  out.topRows(n) *= state.sign_x;
  out.bottomRows(n) *= state.sign_y;
  return out;
}

double chip_thickness_m(const CutState& state, double feed_per_tooth_m, double angle_rad) {
  const Engagement arc = engagement_of(state);
  const double lag = total_lag(state) / 2;
  double sum = 0;
  for (std::size_t j = 0; j < static_cast<std::size_t>(state.tool.teeth); ++j) {
    double theta = angle_rad + state.zero_rad + pitch_angle(state.tool, j) - lag;
    theta -= kTwoPi * std::floor((theta - arc.start_rad) / kTwoPi);
    if (theta <= arc.exit_rad) sum += feed_per_tooth_m * std::sin(theta);
  }
  return sum;
}

}  // namespace servosense::reconcile
