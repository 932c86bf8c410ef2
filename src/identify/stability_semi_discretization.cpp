#include <Eigen/Dense>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <complex>
#include <limits>
#include <optional>
#include <thread>

#include "dsp/dense.hpp"
#include "revolution_map.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/io/text.hpp"
#include "stability_loop.hpp"
#include "tooth_pass_map.hpp"

namespace servosense {
namespace {

using Complex = std::complex<double>;
using Eigen::MatrixXd;
using Eigen::VectorXd;
constexpr double kStableEverywhere = std::numeric_limits<double>::infinity();

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

/// Unit eigenvector of an eigenvalue that is known to rounding.
Eigen::VectorXcd eigenvector(const MatrixXd& matrix, Complex value) {
  const Complex shift = value * (1 + 1e-13) + 1e-300;  // keeps the factorisation regular
  Eigen::MatrixXcd shifted = matrix.cast<Complex>();
  shifted.diagonal().array() -= shift;
  return dense::vector_next_to_zero(shifted);
}

/// Largest eigenvalue of the map and the mode part of its vector, by Arnoldi iteration. The
/// spectrum of a delay map crowds at zero, so a short Krylov space holds what matters.
struct Dominant {
  Complex value;
  Eigen::VectorXcd modes;
};

template <typename Map>
Dominant dominant_of(const Map& map, double tolerance) {
  const auto n = static_cast<Eigen::Index>(map.size());
  const Eigen::Index states = 2 * static_cast<Eigen::Index>(map.modes().size());
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
    if (residual <= tolerance * std::abs(value) || closed || k == most)
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
  return create(structure, tool, engagement_of(tool, cut), config);
}

Expected<SemiDiscretization> SemiDiscretization::create(const Structure& structure,
                                                        const MillingTool& tool,
                                                        const Engagement& engagement,
                                                        const SemiDiscretizationConfig& config) {
  MillingCut slot;
  slot.direction = MillingDirection::slot;
  if (auto error = refuse_cut(tool, slot)) return *error;
  if (!(engagement.swept_rad() > 0 && engagement.swept_rad() <= kTwoPi * (1 + 1e-12)))
    return usage_error("The swept angle must lie between 0 and a turn.");
  if (auto error = refuse_structure(structure)) return *error;
  if (!tool.tooth_angle_rad.empty() &&
      tool.tooth_angle_rad.size() != static_cast<std::size_t>(tool.teeth))
    return data_error("The tool has " + std::to_string(tool.teeth) + " teeth and " +
                      std::to_string(tool.tooth_angle_rad.size()) +
                      " tooth angles: give one for each tooth.");
  if (config.hold_order < 1 || config.hold_order > kHighestHoldOrder)
    return usage_error("The hold order must lie between 1 and " +
                       std::to_string(kHighestHoldOrder) + ".");
  if (!(config.phase_per_interval_rad > 0 && config.phase_per_interval_rad <= kPi))
    return usage_error("The phase per interval must lie between 0 and pi.");
  if (!(config.multiplier_tolerance > 0))
    return usage_error("The tolerance of the multiplier must be above zero.");
  return SemiDiscretization(structure, tool, engagement, config);
}

namespace {

/// Vibrations of the fastest mode between two teeth up to which a chart takes minutes and its maps
/// some megabytes: a limit of cost. Lobes there are much closer than any chart shows.
constexpr double kMostVibrations = 1000;

std::optional<Error> refuse_too_slow(const Structure& structure, const MillingTool& tool,
                                     std::span<const double> spindle_speed_rpm) {
  double highest_hz = 0;
  for (const auto* modes : {&structure.x, &structure.y})
    for (const StructuralMode& m : *modes)
      highest_hz = std::max(highest_hz, m.natural_frequency_hz);
  const double slowest_rpm = 60 * highest_hz / (tool.teeth * kMostVibrations);
  const double asked_rpm = *std::min_element(spindle_speed_rpm.begin(), spindle_speed_rpm.end());
  if (asked_rpm >= slowest_rpm) return std::nullopt;
  return usage_error("at " + number_text(asked_rpm) +
                     " rpm there are more than 1000 vibrations between two teeth, too many for "
                     "semi-discretisation; begin at " +
                     number_text(std::ceil(slowest_rpm)) +
                     " rpm or more, or take the zeroth order (zoa)");
}

}  // namespace

SemiDiscretization::SemiDiscretization(const Structure& structure, const MillingTool& tool,
                                       const Engagement& engagement,
                                       const SemiDiscretizationConfig& config)
    : structure_(structure), tool_(tool), engagement_(engagement), config_(config) {}

double SemiDiscretization::spectral_radius(double spindle_speed_rpm, double axial_depth_m) const {
  if (needs_revolution_map(tool_)) {
    const RevolutionMap map(structure_, tool_, engagement_, spindle_speed_rpm, axial_depth_m);
    return std::pow(std::abs(dominant_of(map, config_.multiplier_tolerance).value),
                    1.0 / tool_.teeth);
  }
  const ToothPassMap map(structure_, tool_, engagement_, config_, spindle_speed_rpm, axial_depth_m);
  return std::abs(dominant_of(map, config_.multiplier_tolerance).value);
}

CriticalMultiplier SemiDiscretization::critical_multiplier(double spindle_speed_rpm,
                                                           double axial_depth_m) const {
  const bool whole_turn = needs_revolution_map(tool_);
  const Dominant dominant = whole_turn
                                ? dominant_of(RevolutionMap(structure_, tool_, engagement_,
                                                            spindle_speed_rpm, axial_depth_m),
                                              config_.multiplier_tolerance)
                                : dominant_of(ToothPassMap(structure_, tool_, engagement_, config_,
                                                           spindle_speed_rpm, axial_depth_m),
                                              config_.multiplier_tolerance);
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
  if (whole_turn) result.multiplier = std::pow(result.multiplier, 1.0 / tool_.teeth);
  if (real) result.loss = dominant.value.real() < 0 ? StabilityLoss::flip : StabilityLoss::fold;

  const double period = 60 / ((whole_turn ? 1 : tool_.teeth) * spindle_speed_rpm);
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
  return {spindle_speed_rpm, kStableEverywhere, std::numeric_limits<double>::quiet_NaN()};
}

Expected<StabilityChart> SemiDiscretization::chart(std::span<const double> spindle_speed_rpm,
                                                   std::span<const double> axial_depth_m,
                                                   unsigned threads,
                                                   const std::function<void(double)>& done) const {
  if (auto error = refuse_axis(spindle_speed_rpm, "spindle speed", "rpm")) return *error;
  if (auto error = refuse_axis(axial_depth_m, "axial depth", "m")) return *error;
  if (!std::is_sorted(axial_depth_m.begin(), axial_depth_m.end()))
    return usage_error("The depths of a stability chart must rise.");
  if (auto error = refuse_too_slow(structure_, tool_, spindle_speed_rpm)) return *error;
  const std::size_t speeds = spindle_speed_rpm.size();
  const std::size_t depths = axial_depth_m.size();
  StabilityChart chart;
  chart.spindle_speed_rpm.assign(spindle_speed_rpm.begin(), spindle_speed_rpm.end());
  chart.axial_depth_m.assign(axial_depth_m.begin(), axial_depth_m.end());
  chart.spectral_radius.resize(speeds * depths);
  chart.limit.resize(speeds);

  // Each speed is worked out whole by one thread, into its own place: the order does not matter.
  std::atomic<std::size_t> next{0}, finished{0};
  const auto work = [&] {
    for (std::size_t s = next++; s < speeds; s = next++) {
      const double speed = spindle_speed_rpm[s];
      double* row = &chart.spectral_radius[s * depths];
      for (std::size_t d = 0; d < depths; ++d) row[d] = spectral_radius(speed, axial_depth_m[d]);
      const double* unstable = std::find_if(row, row + depths, [](double mu) { return mu >= 1; });
      const auto d = static_cast<std::size_t>(unstable - row);
      chart.limit[s] =
          d == depths
              ? LobePoint{speed, kStableEverywhere, std::numeric_limits<double>::quiet_NaN()}
              : limit_between(speed, d == 0 ? 0 : axial_depth_m[d - 1], axial_depth_m[d]);
      if (done) done(static_cast<double>(++finished) / static_cast<double>(speeds));
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
