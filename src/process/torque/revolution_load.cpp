#include "servosense/process/torque/revolution_load.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace servosense::process {
namespace {

constexpr double kRad = std::numbers::pi / 180;
/// Arcs lie within these [deg]; tables in steps of which the trapezoidal rule is off by 1e-5.
constexpr double kLow_deg = -180, kHigh_deg = 540, kTable_deg = 0.5;
constexpr std::size_t kTableSize =
    static_cast<std::size_t>((kHigh_deg - kLow_deg) / kTable_deg) + 1;

/// Integrals from kLow_deg on [rad]: 1, cos, sin, each times chip (over the feed) or edge.
struct ToothIntegrals {
  std::vector<std::array<double, 6>> at = std::vector<std::array<double, 6>>(kTableSize);

  template <typename Chip>
  explicit ToothIntegrals(const Chip& chip_at) {
    std::array<double, 6> before{};
    for (std::size_t i = 0; i < kTableSize; ++i) {
      const double angle = (kLow_deg + kTable_deg * static_cast<double>(i)) * kRad;
      const auto [chip, edge] = chip_at(std::sin(angle));
      const double c = std::cos(angle), s = std::sin(angle);
      const std::array<double, 6> now = {chip, chip * c, chip * s, edge, edge * c, edge * s};
      if (i > 0)
        for (std::size_t k = 0; k < 6; ++k)
          at[i][k] = at[i - 1][k] + (before[k] + now[k]) / 2 * kTable_deg * kRad;
      before = now;
    }
  }
  [[nodiscard]] std::array<double, 6> between(double from_deg, double to_deg) const {
    const auto low = upto(from_deg);
    auto high = upto(to_deg);
    for (std::size_t k = 0; k < 6; ++k) high[k] -= low[k];
    return high;
  }

 private:
  [[nodiscard]] std::array<double, 6> upto(double deg) const {
    const double place = std::clamp((deg - kLow_deg) / kTable_deg, 0.0, kTableSize - 1.001);
    const auto i = static_cast<std::size_t>(place);
    const double share = place - static_cast<double>(i);
    std::array<double, 6> value{};
    for (std::size_t k = 0; k < 6; ++k) value[k] = at[i][k] + share * (at[i + 1][k] - at[i][k]);
    return value;
  }
};

struct ChipEdge {
  double chip, edge;
};

const ToothIntegrals& even_tooth() {
  static const ToothIntegrals table([](double sine) { return ChipEdge{sine, 1}; });
  return table;
}

/// Of each tooth; one for all that are alike.
std::vector<ToothIntegrals> uneven_teeth(const ToolLaw& law, double feed_m) {
  std::vector<ToothIntegrals> all;
  const std::size_t n = law.throw_m.size();
  for (std::size_t j = 0; j < n; ++j)
    all.emplace_back([&](double sine) {
      double chip = static_cast<double>(n) * sine;  // what the tooth itself left a turn ago
      for (std::size_t k = 1; k < n; ++k)
        chip = std::min(chip, static_cast<double>(k) * sine +
                                  (law.throw_m[j] - law.throw_m[(j + n - k) % n]) / feed_m);
      return chip > 0 ? ChipEdge{chip, 1} : ChipEdge{0, 0};
    });
  return all;
}

}  // namespace

RevolutionLoad revolution_load(const Engagement& e, const ToolLaw& law, double feed_m,
                               bool clockwise) {
  const int each = std::max(8, (kRevolutionSamples + law.teeth - 1) / law.teeth);
  const std::size_t samples = static_cast<std::size_t>(each) * static_cast<std::size_t>(law.teeth);
  RevolutionLoad load;
  load.chip_m2.assign(samples, 0.0);
  load.edge_m2.assign(samples, 0.0);
  if (law.force) load.force_N.assign(samples, {});
  const double sample_deg = 360.0 / static_cast<double>(samples);
  const double lag_deg_per_m = std::tan(law.helix_deg * kRad) / law.radius_m / kRad;
  const double level = std::sqrt(std::max(0.0, 1 - e.rise * e.rise));
  const bool even = law.throw_m.empty() || !(level > 0.5) || !(feed_m > 0);
  const auto teeth = even ? std::vector<ToothIntegrals>() : uneven_teeth(law, feed_m);

  for (const SideContact& contact : e.side) {
    const Arc arc =
        clockwise ? contact.arc : Arc{180 - contact.arc.to_deg, 180 - contact.arc.from_deg};
    const double height = contact.high_m - contact.low_m;
    const double slant = std::sqrt(1 + contact.widening * contact.widening);
    const double sink = -e.rise * contact.widening;
    const double middle_lag = lag_deg_per_m * (contact.low_m + contact.high_m) / 2;
    const double width_deg = std::max(sample_deg, lag_deg_per_m * height);
    const double weight = height / (width_deg * kRad);
    const auto add = [&](std::size_t sample, const std::array<double, 6>& in) {
      // Chip over the feed and edge length, each with its direction.
      std::array<double, 3> chip{}, edge{};
      for (std::size_t k = 0; k < 3; ++k) {
        chip[k] = weight * (level * in[k] + sink * in[k + 3]);
        edge[k] = weight * slant * in[k + 3];
      }
      load.chip_m2[sample] += contact.radius_m * chip[0];
      load.edge_m2[sample] += contact.radius_m * edge[0];
      if (!law.force) return;
      const CuttingForceLaw& f = *law.force;
      const double kt = f.tangential_coefficient_N_per_m2 * feed_m, kr = f.radial_ratio * kt;
      std::array<double, 3> tangential{}, radial{};
      for (std::size_t k = 0; k < 3; ++k) {
        tangential[k] = kt * chip[k] + f.tangential_edge_N_per_m * edge[k];
        radial[k] = (kr * chip[k] + f.radial_edge_N_per_m * edge[k]) / slant;
      }
      auto& force = load.force_N[sample];
      force[0] += -tangential[1] - radial[2];
      force[1] += (tangential[2] - radial[1]) * (clockwise ? 1 : -1);
      force[2] +=
          (f.axial_coefficient_N_per_m2 * feed_m * chip[0] + f.axial_edge_N_per_m * edge[0]) /
              slant +
          contact.widening * radial[0];
    };
    const int turn = even ? each : static_cast<int>(samples);
    for (int j = 0; j < law.teeth; ++j) {
      const ToothIntegrals& tooth = even ? even_tooth() : teeth[static_cast<std::size_t>(j)];
      const double tooth_deg = 360.0 / law.teeth * j;
      for (int i = 0; i < turn; ++i) {
        const double centre = tooth_deg + sample_deg * i - middle_lag;
        const double low = centre - width_deg / 2, high = centre + width_deg / 2;
        const double first = std::ceil((arc.from_deg - high) / 360);
        for (double k = first; low + 360 * k < arc.to_deg; ++k) {
          const double from = std::max(arc.from_deg, low + 360 * k);
          const double to = std::min(arc.to_deg, high + 360 * k);
          if (to > from) add(static_cast<std::size_t>(i), tooth.between(from, to));
        }
      }
    }
  }
  // Teeth that are alike repeat.
  if (even)
    for (std::size_t i = static_cast<std::size_t>(each); i < samples; ++i) {
      const std::size_t from = i - static_cast<std::size_t>(each);
      load.chip_m2[i] = load.chip_m2[from], load.edge_m2[i] = load.edge_m2[from];
      if (law.force) load.force_N[i] = load.force_N[from];
    }
  return load;
}

}  // namespace servosense::process
