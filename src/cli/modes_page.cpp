#include "modes_page.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/core/units.hpp"
#include "servosense/io/report.hpp"

namespace servosense::cli {
namespace {

template <typename Of>
report::Series curve_over_lines(std::string name, const char* unit, const FittedReceptance& r,
                                const std::vector<std::complex<double>>& values, Of of) {
  report::Series series{.name = std::move(name), .unit = unit, .x = r.frequency_hz};
  for (const std::complex<double>& g : values) series.y.push_back(of(g));
  return series;
}

double magnitude(std::complex<double> g) { return std::abs(g); }
double phase_deg(std::complex<double> g) { return std::arg(g) * 360 / kTwoPi; }

report::PlotGroup receptance_plots(const FittedReceptance& r, const ModesIdentification& found) {
  report::PlotGroup group{r.name, {}};
  report::Plot gain, phase;
  gain.x_label = "frequency", gain.x_unit = "Hz";
  gain.y_label = "receptance", gain.log_y = true;
  gain.series = {curve_over_lines("measured", "m/N", r, r.measured_m_per_N, magnitude),
                 curve_over_lines("fitted", "m/N", r, r.fitted_m_per_N, magnitude)};
  gain.series[0].broad = true;
  for (const IdentifiedMode& mode : found.modes)
    gain.marks.push_back(
        {mode.natural_frequency_hz.value,
         "mode at " + report::Cell(mode.natural_frequency_hz.value, 5).text + " Hz",
         mode.doubt.empty() ? report::Level::info : report::Level::warning});
  phase.y_label = "phase", phase.height_px = 140;
  phase.series = {curve_over_lines("measured", "deg", r, r.measured_m_per_N, phase_deg),
                  curve_over_lines("fitted", "deg", r, r.fitted_m_per_N, phase_deg)};
  phase.series[0].broad = true;
  group.plots = {std::move(gain), std::move(phase)};
  return group;
}

report::Plot stabilisation_diagram(const ModesIdentification& found) {
  report::Plot plot;
  plot.title = "Stabilisation diagram";
  plot.caption =
      "Poles of rising order. What comes back from the order below is stable; what is a mode is "
      "decided below.";
  plot.x_label = "frequency", plot.x_unit = "Hz";
  plot.y_label = "order";
  report::Series stable{.name = "stable", .unit = "", .style = report::Series::Style::points};
  report::Series once{.name = "new", .unit = "", .style = report::Series::Style::points};
  once.faint = true;
  const auto& lines = found.receptances.front().frequency_hz;
  for (const DiagramPole& pole : found.diagram) {
    if (pole.frequency_hz < lines.front() || pole.frequency_hz > lines.back()) continue;
    report::Series& series = pole.stable ? stable : once;
    series.x.push_back(pole.frequency_hz);
    series.y.push_back(pole.order);
  }
  plot.series = {std::move(once), std::move(stable)};
  for (const IdentifiedMode& mode : found.modes)
    plot.marks.push_back({mode.natural_frequency_hz.value, "", report::Level::info});
  return plot;
}

std::string with_error(const Estimate& e, double scale = 1) {
  return report::Cell(scale * e.value, 5).text + " +- " +
         report::Cell(scale * e.standard_error, 2).text;
}

report::Table table_of_modes(const ModesIdentification& found) {
  report::Table table{.title = "Modes", .caption = "With standard errors."};
  table.header = {"natural frequency, Hz", "damping ratio, %", "modal mass, kg",
                  "lines in its peak", "remark"};
  for (const IdentifiedMode& mode : found.modes)
    table.rows.push_back(
        {{with_error(mode.natural_frequency_hz), with_error(mode.damping_ratio, 100),
          std::isnan(mode.modal_mass_kg.value) ? "unknown" : with_error(mode.modal_mass_kg),
          report::Cell(mode.lines_in_peak, 3), mode.doubt},
         mode.doubt.empty() ? report::Level::none : report::Level::warning});
  return table;
}

report::Table table_of_others(const ModesIdentification& found) {
  report::Table table{.title = "Poles that are no modes", .folded = true};
  table.header = {"frequency, Hz", "damping ratio, %", "why not"};
  for (const PoleTurnedDown& pole : found.turned_down)
    table.rows.push_back({{report::Cell(pole.frequency_hz, 5),
                           report::Cell(100 * pole.damping_ratio, 3), pole.reason}});
  return table;
}

}  // namespace

Expected<Done> write_modes_page(const std::string& path, const std::vector<ModesOfAxis>& all) {
  std::string sources;
  for (const ModesOfAxis& a : all)
    for (const FittedReceptance& r : a.found.receptances)
      sources += (sources.empty() ? "" : ", ") + r.name;
  report::Report page("Modes", sources);
  for (const ModesOfAxis& a : all) {
    if (all.size() > 1) page.add(report::Heading{"Direction " + a.axis});
    for (const std::string& remark : a.found.remarks)
      page.add(report::Note{remark + ".", report::Level::warning});
    page.add(table_of_modes(a.found));
    for (const FittedReceptance& r : a.found.receptances) page.add(receptance_plots(r, a.found));
    page.add(stabilisation_diagram(a.found));
    page.add(table_of_others(a.found));
  }
  return page.write(path);
}

}  // namespace servosense::cli
