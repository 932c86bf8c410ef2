#include "impact_report.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/io/report.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

constexpr std::size_t kDrawnHits = 12;  // of either kind: more are a blot

report::Series line_series(const char* name, const char* unit, const ImpactResult& f,
                           const std::vector<double>& y, bool faint = false) {
  report::Series s{name, unit, f.response.frequency_hz, y};
  s.faint = faint;
  return s;
}

template <typename Of>
std::vector<double> each_line(const ImpactResult& f, Of of) {
  std::vector<double> y;
  for (std::size_t i = 0; i < f.response.frequency_hz.size(); ++i) y.push_back(of(i));
  return y;
}

report::PlotGroup impact_spectra(const ImpactResult& f) {
  const auto& g = f.response.receptance_m_per_N;
  const auto& error = f.response.standard_error_m_per_N;
  report::PlotGroup group{"Receptance", {}};
  report::Plot size, real, imaginary, coherence, force;
  size.caption = "Pale: one standard error either way.";
  size.x_label = "frequency", size.x_unit = "Hz";
  size.y_label = "magnitude", size.log_y = true;
  size.series = {
      line_series("low", "m/N", f, each_line(f, [&](auto i) { return std::abs(g[i]) - error[i]; }),
                  true),
      line_series("high", "m/N", f, each_line(f, [&](auto i) { return std::abs(g[i]) + error[i]; }),
                  true),
      line_series("receptance", "m/N", f, each_line(f, [&](auto i) { return std::abs(g[i]); }))};
  if (f.peak_hz > 0)
    size.marks = {
        {f.peak_hz, "highest resonance, " + printed(f.peak_hz, 4) + " Hz", report::Level::info}};
  real.y_label = "real part";
  real.series = {
      line_series("real part", "m/N", f, each_line(f, [&](auto i) { return g[i].real(); }))};
  imaginary.y_label = "imaginary part";
  imaginary.series = {
      line_series("imaginary part", "m/N", f, each_line(f, [&](auto i) { return g[i].imag(); }))};
  coherence.y_label = "coherence", coherence.y_range = {0, 1};
  coherence.series = {line_series("coherence", "", f, f.response.coherence)};
  force.y_label = "force of the hits", force.log_y = true;
  force.series = {line_series("force", "N s", f, f.force_Ns)};
  group.plots = {std::move(size), std::move(real), std::move(imaginary), std::move(coherence),
                 std::move(force)};
  for (report::Plot& plot : group.plots)
    plot.spans = {{f.usable_from_hz, f.usable_to_hz, "usable", report::Level::info}};
  return group;
}

/// Force pulses and responses laid over one another, the time counted from the peak.
report::PlotGroup impact_hits(std::span<const ImpactRecord> records, const ImpactResult& f,
                              const std::string& response_column, bool used) {
  report::PlotGroup group{used ? "Hits that are used" : "Hits that are not used", {}};
  report::Plot force, response;
  force.x_label = "time from the peak", force.x_unit = "ms";
  force.y_label = "force", response.y_label = response_column;
  std::size_t drawn = 0;
  for (const ImpactHit& h : f.hits) {
    const ImpactRecord& r = records[h.record];
    if (h.used != used || h.peak == 0 || drawn == kDrawnHits) continue;
    ++drawn;
    const std::string name = r.name + " at " + printed(h.t_s, 4) + " s";
    report::Series pulse{name, "N", {}, {}}, motion{name, "", {}, {}};
    const std::size_t length =
        h.length > 0 ? h.length : static_cast<std::size_t>(f.length_s * r.sample_rate_hz);
    for (std::size_t i = h.begin; i < std::min(h.begin + length, r.force_N.size()); ++i) {
      const double t =
          1e3 * (static_cast<double>(i) - static_cast<double>(h.peak)) / r.sample_rate_hz;
      pulse.x.push_back(t), pulse.y.push_back(r.force_N[i]);
      motion.x.push_back(t), motion.y.push_back(r.response[i]);
    }
    force.series.push_back(std::move(pulse));
    response.series.push_back(std::move(motion));
  }
  if (drawn > 0) group.plots = {std::move(force), std::move(response)};
  return group;
}

}  // namespace

std::string impact_sentence(const ImpactResult& f) {
  std::string text = std::to_string(f.averages) + " of " + std::to_string(f.hits.size()) +
                     (f.hits.size() == 1 ? " hit" : " hits") + " used; usable from " +
                     printed(f.usable_from_hz, 3) + " to " + printed(f.usable_to_hz, 4) +
                     " Hz, coherence " + printed(f.coherence, 3) + " there";
  if (f.peak_hz > 0)
    text += "; highest resonance " + printed(1e6 * f.peak_m_per_N, 4) + " um/N at " +
            printed(f.peak_hz, 4) + " Hz";
  return text;
}

Expected<Done> write_impact_page(const std::string& path, const std::string& response_column,
                                 std::span<const ImpactRecord> records, const ImpactResult& f) {
  std::string sources;
  for (const ImpactRecord& r : records) sources += (sources.empty() ? "" : ", ") + r.name;
  report::Report page("Receptance from hammer.force_N to " + response_column, sources);
  page.add(report::Note{impact_sentence(f), report::Level::info});
  page.add(report::KeyFigures{{{"hits used", {static_cast<double>(f.averages), 6}, ""},
                               {"usable to", {f.usable_to_hz, 4}, "Hz"},
                               {"highest resonance", {f.peak_hz, 4}, "Hz"},
                               {"there", {1e6 * f.peak_m_per_N, 4}, "um/N"},
                               {"coherence", {f.coherence, 3}, ""},
                               {"standard error", {100 * f.relative_error, 2}, "%"}}});
  for (const std::string& remark : f.remarks)
    page.add(report::Note{remark, report::Level::warning});
  page.add(impact_spectra(f));
  report::Table hits{"Hits", "", {"trace", "time [s]", "peak [N]", "width [ms]", ""}, {}};
  for (const ImpactHit& h : f.hits)
    hits.rows.push_back({{records[h.record].name,
                          {h.t_s, 6},
                          {h.peak_N, 4},
                          {1e3 * h.width_s, 3},
                          h.used ? "used" : h.reason},
                         h.used ? report::Level::none : report::Level::warning});
  page.add(std::move(hits));
  for (const bool used : {true, false})
    if (auto group = impact_hits(records, f, response_column, used); !group.plots.empty())
      page.add(std::move(group));
  return page.write(path);
}

}  // namespace servosense::cli
