#include "reconcile/cut/force_model.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <map>

#include "dsp/fourier.hpp"
#include "reconcile/cut/chip.hpp"
#include "reconcile/numerics/anderson_mixing.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr Eigen::Index kGrid = kCutGrid;
constexpr double kSteep = 4 * kTwoPi / static_cast<double>(kGrid);  // lag of a helix
constexpr double kForceSettled = 1e-7;   // of force and displacement on each other
constexpr double kSettledForced = 1e-6;  // of a forced vibration
constexpr int kLayers = 8;               // of a helix, where the chip follows the structure

/// Parts of the arc in which there is a chip.
std::vector<Engagement> stretches_with_chip(const ArcPoints& arc, const Eigen::ArrayXd& room_m) {
  std::vector<Engagement> stretches;
  const double exit_rad = arc.start_rad + ArcPoints::kSteps * arc.step_rad;
  double before = 0;
  for (Eigen::Index k = 0; k <= ArcPoints::kSteps; ++k) {
    const double theta = arc.start_rad + static_cast<double>(k) * arc.step_rad;
    const double now = room_m(k);
    const double crossing = theta - arc.step_rad * now / (now - before);
    if (now > 0 && !(before > 0)) stretches.push_back({k == 0 ? theta : crossing, exit_rad});
    if (!(now > 0) && before > 0) stretches.back().exit_rad = crossing;
    before = now;
  }
  return stretches;
}

}  // namespace

std::vector<Contact> contacts_of(const CutState& state, double feed_per_tooth_m) {
  std::map<double, std::vector<Contact>> by_back;
  const ArcPoints arc(engagement_of(state));
  const double lag = total_lag(state);
  constexpr double kStep = kTwoPi / static_cast<double>(kGrid);
  const std::complex<double> rotation = std::polar(1.0, 2 * kStep);
  for (const Zone& zone : zones_of(state.tool)) {
    const double share = zone.high - zone.low;
    const int layers = lag == 0 ? 1 : std::max(1, static_cast<int>(std::lround(kLayers * share)));
    const double depth_m = state.cut.axial_depth_m * share / layers;
    for (const std::size_t tooth : zone.teeth) {
      const std::vector<Engagement> stretches =
          stretches_with_chip(arc, room_m(state, zone, tooth, feed_per_tooth_m, arc));
      const double own = pitch_angle(state.tool, tooth);
      double before = kTwoPi;
      for (const std::size_t other : zone.teeth) {
        double ahead = pitch_angle(state.tool, other) - own;
        ahead -= kTwoPi * std::floor(ahead / kTwoPi);
        if (other != tooth && ahead > 0) before = std::min(before, ahead);
      }
      std::vector<Contact>& sums = by_back[std::round(before / kStep * 1e6) * 1e-6];
      if (sums.empty()) sums.resize(static_cast<std::size_t>(kGrid));
      for (int layer = 0; layer < layers; ++layer) {
        const double height = zone.low + share * (layer + 0.5) / layers;
        for (const Engagement& stretch : stretches) {
          double first = own + state.zero_rad - lag * height - stretch.start_rad;
          first -= kTwoPi * std::floor(first / kTwoPi);
          // From the first angle of the grid in the stretch, products by rotation.
          auto i = static_cast<Eigen::Index>(std::ceil((kTwoPi - first) / kStep));
          const double past = first + kStep * static_cast<double>(i) - kTwoPi;
          const double twice = 2 * (stretch.start_rad + past);
          double cosine = 0.5 * depth_m * std::cos(twice), sine = 0.5 * depth_m * std::sin(twice);
          const auto end =
              i + static_cast<Eigen::Index>(std::floor((stretch.swept_rad() - past) / kStep)) + 1;
          for (; i < end; ++i) {
            Contact& c = sums[static_cast<std::size_t>(i % kGrid)];
            c.ss_m += 0.5 * depth_m - cosine;
            c.sc_m += sine;
            c.cc_m += 0.5 * depth_m + cosine;
            const double last = cosine;
            cosine = last * rotation.real() - sine * rotation.imag();
            sine = last * rotation.imag() + sine * rotation.real();
          }
        }
      }
    }
  }
  std::vector<Contact> contacts;
  for (auto& [back, sums] : by_back)
    for (std::size_t i = 0; i < sums.size(); ++i) {
      if (!(sums[i].ss_m + sums[i].cc_m > 0)) continue;
      sums[i].at = static_cast<Eigen::Index>(i);
      sums[i].back = back;
      contacts.push_back(sums[i]);
    }
  return contacts;
}

namespace {

/// What a vibration adds to the chips: Kt and Kr columns over the grid. `remembered`: chips are
/// thinner by what the tooth before has left.
Eigen::MatrixXd vibration_columns(const std::vector<Contact>& contacts, const Eigen::VectorXd& x,
                                  const Eigen::VectorXd& y, bool remembered) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(2 * kGrid, 2);
  const double left = remembered ? 1 : 0;
  for (const Contact& c : contacts) {
    double g = static_cast<double>(c.at) - c.back;
    if (g < 0) g += static_cast<double>(kGrid);
    const auto k = std::min(static_cast<Eigen::Index>(g), kGrid - 1);
    const Eigen::Index next = k + 1 == kGrid ? 0 : k + 1;
    const double part = g - static_cast<double>(k);
    const double dx = x(c.at) - left * (x(k) + part * (x(next) - x(k)));
    const double dy = y(c.at) - left * (y(k) + part * (y(next) - y(k)));
    const double along_sine = dx * c.ss_m + dy * c.sc_m;
    const double along_cosine = dx * c.sc_m + dy * c.cc_m;
    out(c.at, 0) -= along_cosine;
    out(kGrid + c.at, 0) += along_sine;
    out(c.at, 1) -= along_sine;
    out(kGrid + c.at, 1) -= along_cosine;
  }
  return out;
}

/// Force of process damping on the tool, x then y: against the speed normal to the surface, per
/// cutting speed.
Eigen::VectorXd damping_force(const std::vector<Contact>& contacts, double coefficient_s_N_per_m2,
                              const Eigen::VectorXd& vx, const Eigen::VectorXd& vy) {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(2 * kGrid);
  for (const Contact& c : contacts) {
    out(c.at) -= coefficient_s_N_per_m2 * (vx(c.at) * c.ss_m + vy(c.at) * c.sc_m);
    out(kGrid + c.at) -= coefficient_s_N_per_m2 * (vx(c.at) * c.sc_m + vy(c.at) * c.cc_m);
  }
  return out;
}

FourierTransform& of_a_turn() {
  thread_local FourierTransform transform;  // keeps its tables
  return transform;
}

/// Response of modes at the harmonics of the turn, 0 to kGrid / 2.
Eigen::VectorXcd receptance(const std::vector<StructuralMode>& modes, double speed_rad_s) {
  Eigen::VectorXcd out = Eigen::VectorXcd::Zero(kGrid / 2 + 1);
  for (Eigen::Index k = 0; k < out.size(); ++k)
    for (const StructuralMode& mode : modes)
      out(k) += mode.receptance(speed_rad_s * static_cast<double>(k));
  return out;
}

/// Of a fourth-order Butterworth filter at the harmonics.
Eigen::VectorXcd filter_response(double cut_off_hz, double speed_rad_s) {
  Eigen::VectorXcd out(kGrid / 2 + 1);
  for (Eigen::Index k = 0; k < out.size(); ++k) {
    const double r = static_cast<double>(k) * speed_rad_s / (kTwoPi * cut_off_hz);
    out(k) = 1;
    for (const double damping : {0.38268, 0.92388})  // sines of 22.5 and 67.5 degrees
      out(k) /= std::complex<double>(1 - r * r, 2 * damping * r);
  }
  return out;
}

/// One direction of the structure, whose mean process damping belongs to it.
class Direction {
 public:
  Direction(const std::vector<StructuralMode>& modes, double speed_rad_s, double damping_N_s_per_m)
      : moves_(!modes.empty()) {
    if (!moves_) return;
    to_displacement_ = to_speed_ = receptance(modes, speed_rad_s);
    for (Eigen::Index k = 0; k < to_speed_.size(); ++k) {
      const std::complex<double> iw(0, speed_rad_s * static_cast<double>(k));
      to_displacement_(k) /= 1.0 + iw * damping_N_s_per_m * to_speed_(k);
      to_speed_(k) = iw * to_displacement_(k);
    }
  }
  void push(const Eigen::VectorXd& force_N) {
    if (moves_) harmonics_ = of_a_turn().forward_half(force_N);
  }
  [[nodiscard]] Eigen::VectorXd displacement() const { return through(to_displacement_); }
  [[nodiscard]] Eigen::VectorXd speed() const { return through(to_speed_); }

 private:
  [[nodiscard]] Eigen::VectorXd through(const Eigen::VectorXcd& response) const {
    if (!moves_) return Eigen::VectorXd::Zero(kGrid);
    return of_a_turn().inverse_half(harmonics_.cwiseProduct(response));
  }
  bool moves_;
  Eigen::VectorXcd to_displacement_, to_speed_, harmonics_;
};

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
  if (!gives && !rings(state)) {
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
        mean_x += damping * c.ss_m / static_cast<double>(kGrid);
        mean_y += damping * c.cc_m / static_cast<double>(kGrid);
      }
      Eigen::VectorXd damped = Eigen::VectorXd::Zero(2 * kGrid), held_by_mean = damped;
      Direction along_x(state.structure.x, speed_rad_s, mean_x);
      Direction along_y(state.structure.y, speed_rad_s, mean_y);
      const bool remembered = state.cut.regeneration;
      // A wave that cancels settles by itself; a forced one stands in for the next force in full.
      AndersonMixing mix;
      Eigen::VectorXd force;
      for (int round = 0; round < (remembered ? 1 : 2) * state.vibration_rounds; ++round) {
        const Eigen::VectorXd answer = columns * k + held_by_mean;
        force = remembered || round == 0 ? answer : mix.next(force, answer);
        along_x.push(force.head(kGrid));
        along_y.push(force.tail(kGrid));
        const Eigen::VectorXd x = along_x.displacement(), y = along_y.displacement();
        const Eigen::MatrixXd before = columns.leftCols(2);
        columns.leftCols(2) = rigid.leftCols(2) + vibration_columns(contacts, x, y, remembered);
        if (damping == 0 && (columns.leftCols(2) - before).norm() <
                                (remembered ? kForceSettled : kSettledForced) * before.norm())
          break;
        if (damping == 0 || !(std::abs(k(0)) > 0)) continue;
        const Eigen::VectorXd vx = along_x.speed(), vy = along_y.speed();
        damped = damping_force(contacts, damping, vx, vy);
        held_by_mean.head(kGrid) = mean_x * vx;
        held_by_mean.tail(kGrid) = mean_y * vy;
        columns.col(0) += damped / k(0);
      }
    }
    for (std::size_t axis = 0; axis < 2 && state.sensor; ++axis) {
      const StructuralMode unit{state.sensor->natural_frequency_hz[axis],
                                state.sensor->damping_ratio[axis], 1};
      const Eigen::VectorXcd response = unit.stiffness_N_per_m() * receptance({unit}, speed_rad_s);
      const Eigen::Index from = axis == 0 ? 0 : kGrid;
      for (Eigen::Index c = 0; c < columns.cols(); ++c)
        columns.col(c).segment(from, kGrid) = of_a_turn().inverse_half(
            of_a_turn().forward_half(columns.col(c).segment(from, kGrid)).cwiseProduct(response));
    }
    if (state.filter_hz > 0) {
      const Eigen::VectorXcd response = filter_response(state.filter_hz, speed_rad_s);
      for (Eigen::Index c = 0; c < columns.cols(); ++c)
        for (const Eigen::Index from : {Eigen::Index{0}, kGrid})
          columns.col(c).segment(from, kGrid) = of_a_turn().inverse_half(
              of_a_turn().forward_half(columns.col(c).segment(from, kGrid)).cwiseProduct(response));
    }
    // Between two angles of the grid a step would be a ramp: vibration alone is taken from there.
    const bool steps = !rings(state) && std::abs(total_lag(state)) < kSteep;
    if (steps) columns -= rigid;
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
    if (steps) out += rigid_columns(state, feed_per_tooth_m, angles_rad);
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
