#include "stability_loop.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace servosense {
namespace {

using Complex = std::complex<double>;

std::string text(double value) {
  std::string s = std::to_string(value);
  s.erase(s.find_last_not_of('0') + 1);
  if (!s.empty() && s.back() == '.') s.pop_back();
  return s;
}

Complex sum_of(const std::vector<StructuralMode>& modes, double omega_rad_s) {
  Complex sum = 0;
  for (const StructuralMode& mode : modes) sum += mode.receptance(omega_rad_s);
  return sum;
}

Complex value_of(const ReceptanceTable& table, double omega_rad_s) {
  if (table.frequency_hz.empty()) return 0;
  const double f = omega_rad_s / kTwoPi;
  const auto& grid = table.frequency_hz;
  const auto above = std::upper_bound(grid.begin() + 1, grid.end() - 1, f);
  const auto i = static_cast<std::size_t>(above - grid.begin());
  const double share = (f - grid[i - 1]) / (grid[i] - grid[i - 1]);
  return (1 - share) * table.receptance_m_per_N[i - 1] + share * table.receptance_m_per_N[i];
}

}  // namespace

DirectionalCoefficients engagement_integral(const Engagement& engagement, double radial_ratio) {
  const double c = radial_ratio;
  const auto antiderivative = [c](double p) {
    const double s2 = std::sin(2 * p);
    const double c2 = std::cos(2 * p);
    return DirectionalCoefficients{0.5 * (c2 - 2 * c * p + c * s2), 0.5 * (-s2 - 2 * p + c * c2),
                                   0.5 * (-s2 + 2 * p + c * c2), 0.5 * (-c2 - 2 * c * p - c * s2)};
  };
  const DirectionalCoefficients from = antiderivative(engagement.start_rad);
  const DirectionalCoefficients to = antiderivative(engagement.exit_rad);
  return {to.xx - from.xx, to.xy - from.xy, to.yx - from.yx, to.yy - from.yy};
}

std::optional<Error> refuse_cut(const MillingTool& tool, const MillingCut& cut) {
  if (tool.teeth < 1)
    return data_error("The tool has " + std::to_string(tool.teeth) +
                      " teeth: give 'teeth' as 1 or more.");
  if (!(tool.diameter_m > 0) || !std::isfinite(tool.diameter_m))
    return data_error("The tool diameter must be positive: give 'diameter_m'.");
  const double kt = tool.force.tangential_coefficient_N_per_m2;
  if (!(kt > 0) || !std::isfinite(kt))
    return data_error(
        "Stability lobes need a positive tangential coefficient: give "
        "'tangential_coefficient_N_per_m2'.");
  if (!(tool.force.radial_ratio >= 0) || !std::isfinite(tool.force.radial_ratio))
    return data_error("The radial ratio must be zero or positive: correct 'radial_ratio'.");
  if (!(tool.helix_deg >= 0 && tool.helix_deg < 90))
    return data_error("The helix angle must lie between 0 and 90 degrees: correct 'helix_deg'.");
  if (cut.direction != MillingDirection::slot) {
    if (!(cut.radial_immersion_m > 0))
      return data_error("The radial immersion must be positive: give 'radial_immersion_m'.");
    if (cut.radial_immersion_m > tool.diameter_m)
      return data_error("The radial immersion of " + text(cut.radial_immersion_m * 1e3) +
                        " mm is above the tool diameter of " + text(tool.diameter_m * 1e3) +
                        " mm: correct 'radial_immersion_m'.");
  }
  return std::nullopt;
}

std::optional<int> tooth_off_pitch(const MillingTool& tool) {
  const double pitch = kTwoPi / tool.teeth;
  for (std::size_t i = 0; i < tool.tooth_angle_rad.size(); ++i)
    if (std::abs(tool.tooth_angle_rad[i] - static_cast<double>(i) * pitch) > 1e-9)
      return static_cast<int>(i) + 1;
  return std::nullopt;
}

std::optional<Error> refuse_beyond_zeroth_order(const MillingTool& tool) {
  if (const auto tooth = tooth_off_pitch(tool))
    return data_error("Zeroth-order lobes are for equal tooth pitch only, and tooth " +
                      std::to_string(*tooth) +
                      " stands off its equal pitch; use semi-discretisation (--method sd).");
  if (tool.force.process_damping_N_per_m != 0)
    return data_error(
        "Zeroth-order lobes know no process damping, and the machine file has it; use "
        "semi-discretisation (--method sd), or remove [effect.tool.process-damping].");
  return std::nullopt;
}

std::optional<Error> refuse_structure(const Structure& structure) {
  if (structure.x.empty() && structure.y.empty())
    return data_error(
        "The structure has no modes: give 'modes' in [structure.x] or [structure.y].");
  const auto refuse = [](const std::vector<StructuralMode>& modes,
                         const char* axis) -> std::optional<Error> {
    for (std::size_t i = 0; i < modes.size(); ++i) {
      const std::string where =
          "Mode " + std::to_string(i + 1) + " of [structure." + axis + "] has ";
      const StructuralMode& mode = modes[i];
      if (!(mode.natural_frequency_hz > 0) || !std::isfinite(mode.natural_frequency_hz))
        return data_error(where + "no positive natural frequency: correct it.");
      if (!(mode.damping_ratio > 0 && mode.damping_ratio < 1))
        return data_error(where + "a damping ratio of " + text(mode.damping_ratio) +
                          ": it must lie between 0 and 1.");
      if (!(mode.modal_mass_kg > 0) || !std::isfinite(mode.modal_mass_kg))
        return data_error(where + "a modal mass of " + text(mode.modal_mass_kg) +
                          " kg: it must be positive.");
    }
    return std::nullopt;
  };
  if (auto error = refuse(structure.x, "x")) return error;
  return refuse(structure.y, "y");
}

std::optional<Error> refuse_axis(std::span<const double> values, const std::string& what,
                                 const std::string& unit) {
  if (values.empty()) return usage_error("No " + what + " was given: give at least one.");
  for (const double value : values)
    if (!(value > 0) || !std::isfinite(value))
      return usage_error("A " + what + " of " + text(value) + " " + unit +
                         " has no stability limit: give positive values.");
  return std::nullopt;
}

OrientedReceptance::OrientedReceptance(const DirectionalCoefficients& alpha, Structure structure)
    : alpha_(alpha), structure_(std::move(structure)) {
  double lowest = HUGE_VAL;
  double highest = 0;
  for (const auto* modes : {&structure_.x, &structure_.y}) {
    for (const StructuralMode& mode : *modes) {
      const double wn = mode.natural_frequency_rad_s();
      lowest = std::min(lowest, wn);
      highest = std::max(highest, wn);
      // Ten points per half-power width at the peak, spreading out evenly in log distance from it.
      const double reach = std::asinh(0.99 / mode.damping_ratio);
      const int steps = static_cast<int>(std::ceil(reach / 0.1));
      for (int i = -steps; i <= steps; ++i) {
        const double w = wn * (1 + mode.damping_ratio * std::sinh(reach * i / steps));
        grid_rad_s_.push_back(w);
      }
    }
  }
  // The flanks: far below the first mode and above the last, where limit depths are huge but are
  // still what limits very low and very high speeds.
  const double from = std::log(lowest * 1e-3);
  const double to = std::log(highest * 1e2);
  const int steps = static_cast<int>(std::ceil((to - from) * 25));
  for (int i = 0; i <= steps; ++i) grid_rad_s_.push_back(std::exp(from + (to - from) * i / steps));
  follow();
}

OrientedReceptance::OrientedReceptance(const DirectionalCoefficients& alpha,
                                       ToolTipReceptance receptance)
    : alpha_(alpha), tables_(std::move(receptance)) {
  double from = 0;
  double to = HUGE_VAL;
  for (const auto* table : {&tables_.xx, &tables_.yy, &tables_.xy, &tables_.yx}) {
    if (table->frequency_hz.empty()) continue;
    from = std::max(from, table->frequency_hz.front());
    to = std::min(to, table->frequency_hz.back());
    for (std::size_t i = 0; i + 1 < table->frequency_hz.size(); ++i) {
      const double step = table->frequency_hz[i + 1] - table->frequency_hz[i];
      for (int part = 0; part < 4; ++part)
        grid_rad_s_.push_back(kTwoPi * (table->frequency_hz[i] + 0.25 * part * step));
    }
    grid_rad_s_.push_back(kTwoPi * table->frequency_hz.back());
  }
  std::erase_if(grid_rad_s_,
                [&](double w) { return !(w > 0) || w < kTwoPi * from || w > kTwoPi * to; });
  follow();
}

OrientedReceptance::Eigenvalues OrientedReceptance::at(double omega_rad_s) const {
  Complex xx, yy, xy, yx;
  if (tables_.xx.frequency_hz.empty() && tables_.yy.frequency_hz.empty()) {
    xx = sum_of(structure_.x, omega_rad_s);
    yy = sum_of(structure_.y, omega_rad_s);
  } else {
    xx = value_of(tables_.xx, omega_rad_s);
    yy = value_of(tables_.yy, omega_rad_s);
    xy = value_of(tables_.xy, omega_rad_s);
    yx = value_of(tables_.yx, omega_rad_s);
  }
  const Complex half_trace =
      0.5 * (alpha_.xx * xx + alpha_.xy * yx + alpha_.yx * xy + alpha_.yy * yy);
  const Complex determinant = (alpha_.xx * alpha_.yy - alpha_.xy * alpha_.yx) * (xx * yy - xy * yx);
  const Complex root = std::sqrt(half_trace * half_trace - determinant);
  // The larger eigenvalue first and the other from the determinant: no cancellation, and an exact
  // zero when one direction is rigid.
  const bool same_side = std::real(std::conj(half_trace) * root) >= 0;
  const Complex larger = half_trace + (same_side ? root : -root);
  return {larger, larger == 0.0 ? Complex(0) : determinant / larger};
}

void OrientedReceptance::follow() {
  std::sort(grid_rad_s_.begin(), grid_rad_s_.end());
  const auto last = std::unique(grid_rad_s_.begin(), grid_rad_s_.end(),
                                [](double a, double b) { return b - a <= 1e-9 * b; });
  grid_rad_s_.erase(last, grid_rad_s_.end());
  on_grid_.reserve(grid_rad_s_.size());
  for (const double w : grid_rad_s_) {
    Eigenvalues next = at(w);
    if (!on_grid_.empty()) {
      const Eigenvalues& before = on_grid_.back();
      if (std::abs(next[1] - before[0]) + std::abs(next[0] - before[1]) <
          std::abs(next[0] - before[0]) + std::abs(next[1] - before[1]))
        std::swap(next[0], next[1]);
    }
    on_grid_.push_back(next);
  }
}

Complex OrientedReceptance::near(double omega_rad_s, Complex neighbour) const {
  const Eigenvalues both = at(omega_rad_s);
  return std::norm(both[0] - neighbour) <= std::norm(both[1] - neighbour) ? both[0] : both[1];
}

}  // namespace servosense
