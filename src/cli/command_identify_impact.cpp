// servosense identify impact: the receptance of a tool from hammer hits.
#include <array>
#include <cstdio>
#include <iostream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "hammer_records.hpp"
#include "impact_report.hpp"
#include "servosense/identify/impact.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/frf_file.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/write_file.hpp"

namespace servosense::cli {
namespace {

/// What a motion of the struck part is, if the column is one.
std::optional<ResponseQuantity> response_quantity(Signal s) {
  switch (s.quantity) {
    case Quantity::displacement_m:
    case Quantity::displacement_x_m:
    case Quantity::displacement_y_m:
      return ResponseQuantity::displacement;
    case Quantity::velocity_m_s:
      return ResponseQuantity::velocity;
    case Quantity::acceleration_m_s2:
    case Quantity::acceleration_x_m_s2:
    case Quantity::acceleration_y_m_s2:
      return ResponseQuantity::acceleration;
    default:
      return {};
  }
}

void print_impact_json(const Arguments& arguments, const HammerRecords& test,
                       const ImpactResult& f) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("out", arguments.at("--out"));
  json.member("response", column_name(test.response));
  json.member("averages", f.averages);
  json.objects("hits", f.hits, [&](const ImpactHit& h) {
    json.member("trace", test.records[h.record].name);
    json.member("t_s", h.t_s);
    json.member("peak_N", h.peak_N);
    json.member("width_s", h.width_s);
    json.member("used", h.used);
    json.member("reason", h.reason);
  });
  json.member("usable_from_hz", f.usable_from_hz);
  json.member("usable_to_hz", f.usable_to_hz);
  json.member("coherence", f.coherence);
  json.member("relative_error", f.relative_error);
  if (f.peak_hz > 0) {
    json.member("peak_hz", f.peak_hz);
    json.member("peak_m_per_N", f.peak_m_per_N);
  } else {
    json.member("peak_hz", nullptr);
    json.member("peak_m_per_N", nullptr);
  }
  json.member("sample_rate_hz", f.sample_rate_hz);
  json.member("length_s", f.length_s);
  json.member("exponential_window_per_s", f.response.exponential_window_per_s);
  json.member("window_noise_gain", f.window_noise_gain);
  json.member("force_noise_N", f.force_noise_N);
  json.member("response_noise", f.response_noise);
  json.member("widened_by", f.widened_by);
  json.member("offset_factor", f.offset_factor);
  json.values("softened_hz", f.softened_hz);
  json.values("remarks", f.remarks);
  json.end_object();
  std::cout << '\n';
}

Expected<ImpactOptions> impact_options(const Arguments& arguments) {
  ImpactOptions options;
  const std::string estimator = arguments.value("--estimator").value_or("h1");
  constexpr std::array<const char*, 3> kEstimators = {"h1", "h2", "hv"};
  bool known = false;
  for (std::size_t i = 0; i < kEstimators.size(); ++i)
    if (estimator == kEstimators[i]) options.estimator = static_cast<FrfEstimator>(i), known = true;
  if (!known) return usage_error("--estimator takes h1, h2 or hv, not " + in_quotes(estimator));
  const auto length = arguments.positive("--length-s");
  if (!length) return length.error();
  options.length_s = length->value_or(0);
  const auto window = arguments.within("--exponential-window", 0, 1e6, "1/s");
  if (!window) return window.error();
  options.exponential_window_per_s = *window;
  const auto offset = arguments.within("--offset-m", 0, 1, "m");
  if (!offset) return offset.error();
  const auto stick_out = arguments.positive("--stick-out-m");
  if (!stick_out) return stick_out.error();
  if (offset->has_value() != stick_out->has_value())
    return usage_error("--offset-m and --stick-out-m go together: give both, or none");
  options.offset_m = offset->value_or(0);
  options.stick_out_m = stick_out->value_or(0);
  options.reversed = arguments.has("--reverse");
  return options;
}

int run_identify_impact(const Arguments& arguments) {
  auto options = impact_options(arguments);
  if (!options) return fail(options.error());
  const auto format = frf_format(arguments.at("--out"), arguments.value("--format").value_or(""));
  if (!format) return fail(format.error());
  Progress progress("reading", arguments.quiet());
  const auto test = read_hammer_records(
      arguments,
      {[](Signal s) { return response_quantity(s).has_value(); }, arguments.value("--response"),
       "that is a displacement, velocity or acceleration",
       "tool.displacement_x_m or tool.acceleration_x_m_s2 (or y)"},
      progress);
  if (!test) return fail(test.error());
  options->response = *response_quantity(test->response);
  const auto f = identify_impact(test->records, *options);
  if (!f) return fail(f.error());
  const std::string title = "receptance, hammer.force_N to " + column_name(test->response) + ", " +
                            std::to_string(f->averages) + " hits";
  if (auto done = write_file(arguments.at("--out"), frf_text(f->response, *format, title)); !done)
    return fail(done.error());
  if (const auto page = arguments.value("--report"))
    if (auto done = write_impact_page(*page, column_name(test->response), test->records, *f); !done)
      return fail(done.error());
  for (const std::string& remark : f->remarks) note(remark, arguments.quiet());
  if (arguments.json()) {
    print_impact_json(arguments, *test, *f);
    return 0;
  }
  say("%s\n", impact_sentence(*f).c_str());
  for (const ImpactHit& h : f->hits)
    if (!h.used)
      say("  not used, %s at %.4f s: %s\n", test->records[h.record].name.c_str(), h.t_s,
          h.reason.c_str());
  return 0;
}

}  // namespace

Program identify_impact_program() {
  return {
      {"identify impact",
       "receptance of a tool from hammer hits",
       {{"--out", "FRF", "receptance file", true, FileUse::output},
        {"--format", "FORMAT", "of it: csv, columns or uff58; else by the ending of its name"},
        {"--report", "FILE", "HTML page with its pictures", false, FileUse::output},
        {"--response", "COLUMN", "motion of the tool, where the traces have several"},
        {"--reverse", "", "the sensor counts against the direction of the hammer"},
        {"--estimator", "NAME", "h1 (default), h2 or hv"},
        {"--length-s", "SECONDS", "of each hit's segment; chosen when not given"},
        {"--exponential-window", "PER_S", "rate of the window on the response; 0: none"},
        {"--offset-m", "METRES", "the hammer hits so far above the sensor"},
        {"--stick-out-m", "METRES", "of the tool from its holder, for the offset"}},
       "TRACE...",
       "Traces with hammer.force_N and one of tool.displacement_x_m, tool.acceleration_x_m_s2 (or "
       "y), one\n"
       "or several hits each. Hit five times, let the record begin before the hit and last until "
       "the tool\n"
       "is still."},
      run_identify_impact};
}

}  // namespace servosense::cli
