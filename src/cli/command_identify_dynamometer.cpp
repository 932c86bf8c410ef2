// servosense identify dynamometer: modes of a dynamometer from its own frequency response.
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "estimate_text.hpp"
#include "servosense/identify/dynamometer_modes.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/table_file.hpp"
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
  const std::string& path = arguments.at("--frf");
  auto response = read_response(path);
  if (!response) return fail(response.error());
  auto fit = fit_dynamometer_modes(response->frequency_hz, response->value, options);
  if (!fit) return fail(Error{fit.error().kind, path + ": " + fit.error().sentence});

  std::vector<std::string> remarks;
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
    json.objects("modes", fit->modes, [&](const DynamometerMode& m) {
      json.member("natural_frequency_hz", m.natural_frequency_hz);
      json.member("damping_ratio", m.damping_ratio);
      json.member("share", m.share);
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
  say("%12s %10s %10s\n", "mode Hz", "damping", "share");
  for (const DynamometerMode& m : fit->modes)
    say("%12.2f %10.5f %10.4f\n", m.natural_frequency_hz, m.damping_ratio, m.share);
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
            {"--frf", "FILE", "measured over applied force, as identify transfer writes it", true,
             FileUse::input},
            {"--direction", "NAME", "x, y or z", true},
            {"--modes", "N", "how many, 1 to 8 (as many, up to 5, as it shows)"},
            {"--from", "HZ", "lowest line used"},
            {"--to", "HZ", "highest line used"},
            {"--out", "FILE", "machine file to write, with [dynamometer.x] modes", true,
             FileUse::renewed}},
           "",
           "Hit the dynamometer with an impact hammer where the tool will cut, record\n"
           "hammer.force_N and dyno.force_x_N, and make the response with\n"
           "'servosense identify transfer --input hammer.force_N --output dyno.force_x_N'."},
          run_identify_dynamometer};
}

}  // namespace servosense::cli
