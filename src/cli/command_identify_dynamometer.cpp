// servosense identify dynamometer: modes of a dynamometer from its own frequency response.
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <iostream>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "estimate_text.hpp"
#include "hammer_records.hpp"
#include "servosense/identify/dynamometer_modes.hpp"
#include "servosense/identify/impact.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/table_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/observer/dynamometer_filter.hpp"

namespace servosense::cli {
namespace {

constexpr double kLeastCoherence = 0.8;
constexpr double kUnitGainWithin = 0.03;  // of 1, that two calibrations agree to
constexpr double kPoorFit = 0.1;

struct Response {
  std::vector<double> frequency_hz;
  std::vector<std::complex<double>> value;
  std::size_t incoherent = 0;
  double exponential_window_per_s = 0;
};

/// What `identify transfer --out` writes: frequency_hz, gain, phase_rad and coherence by their
/// headings.
Expected<Response> read_response(const std::string& path) {
  auto file = TableFile::open(path, {',', DecimalMark::point});
  if (!file) return file.error();
  const std::vector<std::string>& headings = file->layout().headings;
  const auto column = [&](const char* name) -> std::optional<std::size_t> {
    for (std::size_t i = 0; i < headings.size(); ++i)
      if (headings[i] == name) return i;
    return std::nullopt;
  };
  const auto frequency = column("frequency_hz"), gain = column("gain"), phase = column("phase_rad"),
             coherence = column("coherence");
  if (!frequency || !gain || !phase)
    return data_error(path +
                      ": expected columns frequency_hz, gain and phase_rad; make the table with "
                      "'servosense identify transfer --input hammer.force_N --output "
                      "dyno.force_x_N --out'");
  Response r;
  TableRow row;
  for (;;) {
    auto more = file->next(row);
    if (!more) return more.error();
    if (!*more) break;
    const auto number = [&](std::size_t at) {
      const TableNumber n = table_number(row.fields[at], DecimalMark::point);
      return n.state == TableNumber::State::value ? n.value : std::nan("");
    };
    const std::complex<double> value = std::polar(1.0, number(*phase)) * number(*gain);
    if (!std::isfinite(value.real()) || !std::isfinite(number(*frequency))) continue;
    if (coherence && !(number(*coherence) >= kLeastCoherence)) {
      ++r.incoherent;
      continue;
    }
    r.frequency_hz.push_back(number(*frequency));
    r.value.push_back(value);
  }
  return r;
}

/// From hits, as `identify impact` has it; what is measured is a force, and is not integrated.
Expected<Response> response_of_hits(const Arguments& arguments, const std::string& column,
                                    std::vector<std::string>& remarks) {
  Progress progress("reading", arguments.quiet());
  const auto hits = read_hammer_records(
      arguments, {[&](Signal s) { return column_name(s) == column; }, column, "", column.c_str()},
      progress);
  if (!hits) return hits.error();
  const auto found = identify_impact(hits->records);
  if (!found) return found.error();
  for (const std::string& remark : found->remarks) remarks.push_back(remark);
  for (const ImpactHit& hit : found->hits)
    if (!hit.used)
      remarks.push_back(hits->records[hit.record].name + ": the hit at " + printed(hit.t_s, 5) +
                        " s is not used: " + hit.reason);
  const FrequencyResponse& all = found->response;
  Response r;
  r.exponential_window_per_s = all.exponential_window_per_s;
  for (std::size_t i = 0; i < all.frequency_hz.size(); ++i) {
    if (!all.coherence.empty() && !(all.coherence[i] >= kLeastCoherence)) {
      ++r.incoherent;
      continue;
    }
    r.frequency_hz.push_back(all.frequency_hz[i]);
    r.value.push_back(all.receptance_m_per_N[i]);
  }
  return r;
}

int run_identify_dynamometer(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  const std::string& direction = arguments.at("--direction");
  if (direction != "x" && direction != "y" && direction != "z")
    return fail(usage_error("--direction: expected x, y or z, found '" + direction + "'"));
  DynamometerFitOptions options;
  auto modes = arguments.within("--modes", 1, static_cast<double>(kMostDynamometerModes));
  if (!modes) return fail(modes.error());
  auto from = arguments.positive("--from"), to = arguments.positive("--to");
  if (!from) return fail(from.error());
  if (!to) return fail(to.error());
  if (*modes) options.modes = static_cast<std::size_t>(std::lround(**modes));
  options.from_hz = from->value_or(options.from_hz);
  options.to_hz = to->value_or(options.to_hz);
  const auto table = arguments.value("--frf");
  if (table.has_value() != arguments.operands().empty())
    return fail(usage_error("give either traces of hits or their response, --frf FILE"));
  const std::string column = "dyno.force_" + direction + "_N";
  const std::string path = table ? *table : arguments.operands().front();
  std::vector<std::string> remarks;
  auto response = table ? read_response(path) : response_of_hits(arguments, column, remarks);
  if (!response) return fail(response.error());
  options.exponential_window_per_s = response->exponential_window_per_s;
  auto fit = fit_dynamometer_modes(response->frequency_hz, response->value, options);
  if (!fit) return fail(Error{fit.error().kind, path + ": " + fit.error().sentence});

  std::array<char, 200> text{};
  if (response->incoherent > 0) {
    std::snprintf(text.data(), text.size(),
                  ": %zu lines have a coherence below %g and are not used", response->incoherent,
                  kLeastCoherence);
    remarks.push_back(path + text.data());
  }
  if (std::abs(fit->static_gain - 1) > kUnitGainWithin) {
    std::snprintf(text.data(), text.size(),
                  ": the static gain is %.3f; hammer and dynamometer do not agree about a newton, "
                  "and the modes are those of unit gain",
                  fit->static_gain);
    remarks.push_back(path + text.data());
  }
  if (fit->misfit > kPoorFit) {
    std::snprintf(text.data(), text.size(),
                  ": the modes are %.0f %% off the response, on average; give --from and --to, or "
                  "--modes",
                  100 * fit->misfit);
    remarks.push_back(path + text.data());
  }
  std::vector<std::array<double, 3>> triples;
  for (const DynamometerMode& m : fit->modes)
    triples.push_back(
        {rounded(m.natural_frequency_hz), rounded(m.damping_ratio), rounded(m.share)});
  machine->set("dynamometer." + direction, "modes", triples, "servosense identify dynamometer");
  if (auto done = machine->write(arguments.at("--out")); !done) return fail(done.error());
  for (const std::string& remark : remarks) note(remark, arguments.quiet());
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("out", arguments.at("--out"));
    std::vector<std::size_t> numbers(fit->modes.size());
    std::iota(numbers.begin(), numbers.end(), std::size_t{0});
    json.objects("modes", numbers, [&](std::size_t k) {
      const DynamometerMode &m = fit->modes[k], &error = fit->standard_errors[k];
      json.member("natural_frequency_hz", m.natural_frequency_hz);
      json.member("natural_frequency_hz_standard_error", error.natural_frequency_hz);
      json.member("damping_ratio", m.damping_ratio);
      json.member("damping_ratio_standard_error", error.damping_ratio);
      json.member("share", m.share);
      json.member("share_standard_error", error.share);
    });
    json.member("static_gain", fit->static_gain);
    json.member("misfit", fit->misfit);
    json.member("from_hz", fit->from_hz);
    json.member("to_hz", fit->to_hz);
    json.values("remarks", remarks);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%22s %20s %20s\n", "mode, Hz", "damping", "share");
  for (std::size_t k = 0; k < fit->modes.size(); ++k) {
    const DynamometerMode &m = fit->modes[k], &error = fit->standard_errors[k];
    say("%12.2f +- %6.2g %10.5f +- %6.2g %10.4f +- %6.2g\n", m.natural_frequency_hz,
        error.natural_frequency_hz, m.damping_ratio, error.damping_ratio, m.share, error.share);
  }
  say("static gain %.4f; %.2f %% off the response from %g to %g Hz\n", fit->static_gain,
      100 * fit->misfit, fit->from_hz, fit->to_hz);
  say("written to %s\n", arguments.at("--out").c_str());
  return 0;
}

}  // namespace

Program identify_dynamometer_program() {
  return {{"identify dynamometer",
           "modes of a dynamometer from its own frequency response",
           {{"--machine", "FILE", "machine file to start from", true, FileUse::input},
            {"--frf", "FILE", "instead of TRACE: the response, as identify transfer writes it",
             false, FileUse::input},
            {"--direction", "NAME", "x, y or z", true},
            {"--modes", "N", "how many, 1 to 8 (as many, up to 5, as it shows)"},
            {"--from", "HZ", "lowest line used"},
            {"--to", "HZ", "highest line used"},
            {"--out", "FILE", "machine file to write, with [dynamometer.x] modes", true,
             FileUse::renewed}},
           "TRACE...",
           "Hit the dynamometer five times with an impact hammer where the tool will cut, and "
           "record hammer.force_N\n"
           "and dyno.force_x_N. Hits are found, judged and averaged as by 'servosense identify "
           "impact'. --frf takes the\n"
           "table of 'servosense identify transfer --input hammer.force_N --output "
           "dyno.force_x_N' instead."},
          run_identify_dynamometer};
}

}  // namespace servosense::cli
