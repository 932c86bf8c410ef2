#include "servosense/process/torque/step_load.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "servosense/model/structural_mode.hpp"
#include "servosense/process/torque/revolution_load.hpp"

namespace servosense::process {
namespace {

/// Of a metric thread (ISO 68-1): the groove between core and nominal diameter is 5/8 of the
/// sharp triangle's height deep, 3/4 of the pitch wide at the core and 1/8 at the bottom; so much
/// of the ring between both diameters is removed.
constexpr double kThreadShare = (0.75 + 0.125) / 2;
/// Below this the tool goes down more than along.
constexpr double kLevelShare = 0.5;

double level_of(const Engagement& e) { return std::sqrt(std::max(0.0, 1 - e.rise * e.rise)); }

/// Length of a contact that is `width_m` wide: r acos(1 - a/r).
double contact_length(double radius_m, double width_m) {
  return radius_m * std::acos(std::clamp(1 - width_m / radius_m, -1.0, 1.0));
}

/// What becomes of the areas when the surfaces of the stock, above and beside the cut, stand
/// `by_m` farther out.
StepAreas grown(const Engagement& e, const StepAreas& areas, double radius_m, double by_m) {
  if (!(level_of(e) > kLevelShare) || !(e.axial_depth_m > 0) || !(e.radial_immersion_m > 0))
    return areas;
  const double depth = e.axial_depth_m, width = e.radial_immersion_m;
  const double new_depth = std::max(0.0, depth + by_m);
  // As wide as the cutter it cannot become wider.
  const bool full = width > 2 * radius_m * (1 - 1e-3);
  const double new_width = full ? width : std::clamp(width + by_m, 0.0, 2 * radius_m);
  const double length = contact_length(radius_m, width);
  return {areas.removed_m2 * (new_depth / depth) * (new_width / width),
          areas.contact_m2 * (new_depth / depth) *
              (full || !(length > 0) ? 1 : contact_length(radius_m, new_width) / length)};
}

/// Amplitude of a harmonic of a revolution.
double amplitude(const std::vector<double>& torque, int order) {
  double c = 0, s = 0;
  const auto n = static_cast<double>(torque.size());
  for (std::size_t i = 0; i < torque.size(); ++i) {
    const double angle = 2 * std::numbers::pi * order * static_cast<double>(i) / n;
    c += torque[i] * std::cos(angle), s += torque[i] * std::sin(angle);
  }
  return 2 * std::hypot(c, s) / n;
}

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

}  // namespace

std::array<double, 2> static_compliance(const MachineFile& machine) {
  std::array<double, 2> compliance = {StepLoad::kUnknown, StepLoad::kUnknown};
  for (std::size_t i = 0; i < 2; ++i) {
    const auto modes = machine.triples(i == 0 ? "structure.x" : "structure.y", "modes");
    if (!modes) continue;
    compliance[i] = 0;
    for (const auto& m : *modes)
      compliance[i] += 1 / StructuralMode{m[0], m[1], m[2]}.stiffness_N_per_m();
  }
  return compliance;
}

StepAreas step_areas(const Engagement& e) {
  return {e.path_m > 0 ? e.removed_m3 / e.path_m : 0, e.side_m2 + e.bottom_m2};
}

double mean_torque_Nm(const StepAreas& areas, const ToolLaw& law, double feed_m) {
  if (!law.torque) return areas.removed_m2 > 0 ? StepLoad::kUnknown : 0;
  if (law.kind == CutterKind::tap)
    return law.torque->torque_Nm(kThreadShare * areas.removed_m2, 0, feed_m);
  return law.torque->torque_Nm(areas.removed_m2, areas.contact_m2, feed_m);
}

StepLoad step_load(const Engagement& e, const ToolLaw& law, const StepConditions& c) {
  StepLoad load;
  if (!e.cuts()) {
    load.torque_Nm = load.low_Nm = load.high_Nm = load.peak_Nm = load.runout_Nm = load.power_W = 0;
    load.harmonic_Nm = {};
    load.force_N = load.least_force_N = load.greatest_force_N = {};
    for (std::size_t i = 0; i < 2; ++i) load.deflection_m[i] = 0 * c.compliance_m_per_N[i];
    return load;
  }
  const double feed = c.feed_per_tooth_m;
  if (!law.torque || !(feed > 0)) return load;
  const StepAreas areas = step_areas(e);
  load.torque_Nm = mean_torque_Nm(areas, law, feed);
  load.power_W = load.torque_Nm * std::abs(c.spindle_rpm) * std::numbers::pi / 30;
  const double error = kBandErrors * law.relative_error.value_or(0);
  const auto with_stock = [&](double by_m) {
    return mean_torque_Nm(grown(e, areas, law.radius_m, by_m), law, feed);
  };
  load.low_Nm =
      std::max(0.0, 1 - error) * std::min(load.torque_Nm, with_stock(-c.stock_tolerance_m));
  load.high_Nm = (1 + error) * std::max(load.torque_Nm, with_stock(c.stock_tolerance_m));
  if (law.kind == CutterKind::tap) {
    load.peak_Nm = load.torque_Nm;
    return load;
  }

  // Over a revolution: the side as its arcs say, brought to what the step removes and touches; a
  // bottom on its way down cuts evenly.
  const RevolutionLoad turn = revolution_load(e, law, feed, c.spindle_rpm >= 0);
  const double bottom_m2 = std::max(0.0, -e.rise) * e.bottom_m2;
  const double side_m2 = std::max(0.0, areas.removed_m2 - bottom_m2);
  const double per_tooth = 2 * std::numbers::pi / law.teeth;
  const double chip_mean = mean_of(turn.chip_m2) * per_tooth, edge_mean = mean_of(turn.edge_m2);
  const double chip = law.torque->k1_N_per_m2 * feed * (chip_mean > 0 ? side_m2 / chip_mean : 0);
  const double edge = law.torque->edge_N_per_m(feed);
  std::vector<double> torque(turn.chip_m2.size());
  for (std::size_t i = 0; i < torque.size(); ++i)
    torque[i] = per_tooth * (chip * turn.chip_m2[i] + edge * turn.edge_m2[i]);
  // What no arc tells is even; without run-out the mean is what the areas say, with it the edges
  // of teeth that pass over their chip are left out.
  const double evenly =
      law.torque->k1_N_per_m2 * feed * (areas.removed_m2 - (chip_mean > 0 ? side_m2 : 0)) +
      edge * e.bottom_m2;
  for (double& value : torque) value += evenly;
  if (!law.throw_m.empty() && edge_mean > 0) {
    const double mean = mean_of(torque), ratio = mean / load.torque_Nm;
    if (ratio < 1) load.torque_Nm *= ratio, load.power_W *= ratio, load.low_Nm *= ratio;
  }
  load.peak_Nm = *std::ranges::max_element(torque);
  for (std::size_t k = 0; k < kToothHarmonics; ++k)
    load.harmonic_Nm[k] = amplitude(torque, law.teeth * static_cast<int>(k + 1));
  load.runout_Nm = law.throw_m.empty() || law.teeth < 2 ? 0 : amplitude(torque, 1);
  if (!law.force) return load;

  load.force_N = {};
  load.least_force_N.fill(std::numeric_limits<double>::infinity());
  load.greatest_force_N.fill(-std::numeric_limits<double>::infinity());
  for (const auto& f : turn.force_N) {
    const std::array<double, 3> on_machine = {f[0] * e.ahead[0] - f[1] * e.ahead[1],
                                              f[0] * e.ahead[1] + f[1] * e.ahead[0], f[2]};
    for (std::size_t i = 0; i < 3; ++i) {
      load.force_N[i] += on_machine[i] / static_cast<double>(turn.force_N.size());
      load.least_force_N[i] = std::min(load.least_force_N[i], on_machine[i]);
      load.greatest_force_N[i] = std::max(load.greatest_force_N[i], on_machine[i]);
    }
  }
  if (e.bottom_m2 > 0) {
    // Radii of a full bottom add up to its radius; the normal of the bottom is the axis.
    const double radius = std::sqrt(e.bottom_m2 / std::numbers::pi);
    const CuttingForceLaw& f = *law.force;
    const double thrust_N =
        law.teeth * radius *
        (f.radial_ratio * f.tangential_coefficient_N_per_m2 * feed * std::max(0.0, -e.rise) +
         f.radial_edge_N_per_m);
    for (auto* of : {&load.force_N, &load.least_force_N, &load.greatest_force_N})
      (*of)[2] += thrust_N;
  }
  for (std::size_t i = 0; i < 2; ++i)
    load.deflection_m[i] =
        c.compliance_m_per_N[i] * std::max(load.greatest_force_N[i], -load.least_force_N[i]);
  return load;
}

}  // namespace servosense::process
