// servosense identify transfer: from one recorded signal to another, gain, phase and coherence.
#include <cmath>
#include <cstdio>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "common_rows.hpp"
#include "console.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/transfer.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/report.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/io/unit_name.hpp"
#include "servosense/io/write_file.hpp"

namespace servosense::cli {
namespace {

Expected<FoundColumn> transfer_column(const std::string& name, const std::string& path,
                                      const Trace& trace, const std::optional<Trace>& estimates) {
  if (const auto at = column_named(trace.signals, name)) return FoundColumn{&trace, *at};
  if (estimates)
    if (const auto at = column_named(estimates->signals, name))
      return FoundColumn{&*estimates, *at};
  std::string there;
  for (const Trace* t : {&trace, estimates ? &*estimates : nullptr})
    if (t != nullptr)
      for (const Signal& s : t->signals) there += (there.empty() ? "" : ", ") + column_name(s);
  return data_error(path + ": there is no column " + name + "; it has " + there);
}

Expected<std::vector<TransferRecord>> read_transfer_records(const Arguments& arguments,
                                                            Progress& progress) {
  const std::vector<std::string> traces = arguments.all("--trace");
  const std::vector<std::string> beside = arguments.all("--estimates");
  if (!beside.empty() && beside.size() != traces.size())
    return usage_error("give one --estimates for each --trace, in the same order");
  std::vector<TransferRecord> records;
  for (std::size_t i = 0; i < traces.size(); ++i) {
    auto trace = read_trace(traces[i]);
    if (!trace) return trace.error();
    std::optional<Trace> estimates;
    if (!beside.empty()) {
      auto read = read_trace(beside[i]);
      if (!read) return read.error();
      if (read->t_s != trace->t_s)
        return data_error(beside[i] + ": its times are not those of " + traces[i] +
                          "; give the estimates that 'servosense monitor' wrote for that trace");
      estimates = std::move(*read);
    }
    auto input = transfer_column(arguments.at("--input"), traces[i], *trace, estimates);
    if (!input) return input.error();
    auto output = transfer_column(arguments.at("--output"), traces[i], *trace, estimates);
    if (!output) return output.error();
    auto rows = common_rows(traces[i], *trace, *input, *output, NoNumber::refuse);
    if (!rows) return rows.error();
    records.push_back(
        {traces[i], rows->sample_rate_hz, std::move(rows->first), std::move(rows->second)});
    progress.show(static_cast<double>(i + 1) / static_cast<double>(traces.size()));
  }
  return records;
}

/// The arrays of the result, under the names that CSV and JSON have for them.
template <typename Visit>
void each_column(const TransferFunction& f, Visit visit) {
  visit("frequency_hz", f.frequency_hz);
  visit("gain", f.gain);
  visit("gain_low", f.gain_low);
  visit("gain_high", f.gain_high);
  visit("phase_rad", f.phase_rad);
  visit("phase_low", f.phase_low);
  visit("phase_high", f.phase_high);
  visit("coherence", f.coherence);
}

std::string transfer_csv(const TransferFunction& f) {
  std::string text;
  std::vector<const std::vector<double>*> columns;
  each_column(f, [&](const char* name, const std::vector<double>& values) {
    text += (text.empty() ? "" : ",") + std::string(name);
    columns.push_back(&values);
  });
  text += '\n';
  for (std::size_t m = 0; m < f.frequency_hz.size(); ++m)
    for (std::size_t c = 0; c < columns.size(); ++c) {
      if (std::isfinite((*columns[c])[m]))
        append_number(text, (*columns[c])[m]);
      else
        text += "nan";
      text += c + 1 < columns.size() ? ',' : '\n';
    }
  return text;
}

/// Unit of the gain: that of the output over that of the input.
std::string gain_unit(const std::string& input, const std::string& output) {
  const auto unit = [](const std::string& column) {
    const auto quantity = quantity_from(column.substr(column.find('.') + 1));
    return quantity ? std::string(unit_of(*quantity)) : std::string();
  };
  const std::string above = unit(output), below = unit(input);
  return above == below ? "" : (above.empty() ? "1" : above) + "/" + (below.empty() ? "1" : below);
}

std::string transfer_sentence(const TransferFunction& f, const std::string& unit) {
  if (!(f.usable_to_hz > 0)) return "no band of it is usable";
  char text[240], constant[40] = "which is constant over no two lines";
  if (f.constant_to_hz > f.usable_from_hz)
    std::snprintf(constant, sizeof constant, "constant within 5 %% up to %.4g Hz",
                  f.constant_to_hz);
  std::snprintf(text, sizeof text,
                "usable from %.3g to %.4g Hz; gain %.4g%s%s, %s; the output comes %.3g ms %s there",
                f.usable_from_hz, f.usable_to_hz, f.low_gain, unit.empty() ? "" : " ", unit.c_str(),
                constant, 1e3 * std::abs(f.late_s), f.late_s < 0 ? "early" : "late");
  return text;
}

report::Series transfer_curve(const char* name, const std::string& unit, const TransferFunction& f,
                              const std::vector<double>& y, double scale = 1, bool faint = false) {
  report::Series s{name, unit, f.frequency_hz, y};
  for (double& v : s.y) v *= scale;
  s.faint = faint;
  return s;
}

/// How far each phase is to be turned so that the curve does not jump.
std::vector<double> whole_turns(const std::vector<double>& phase) {
  std::vector<double> turns(phase.size(), 0.0);
  double before = phase.empty() ? 0 : phase.front(), sum = 0;
  for (std::size_t m = 0; m < phase.size(); ++m) {
    if (std::isfinite(phase[m])) {
      if (std::isfinite(before)) sum -= kTwoPi * std::round((phase[m] + sum - before) / kTwoPi);
      before = phase[m] + sum;
    }
    turns[m] = sum;
  }
  return turns;
}

Expected<Done> write_transfer_page(const std::string& path, const Arguments& arguments,
                                   const TransferFunction& f, const std::string& unit) {
  const std::string &in = arguments.at("--input"), &out = arguments.at("--output");
  std::string sources;
  for (const std::string& t : arguments.all("--trace"))
    sources += (sources.empty() ? "" : ", ") + t;
  report::Report page("Transfer function from " + in + " to " + out, sources);
  const bool usable = f.usable_to_hz > 0;
  page.add(report::Note{transfer_sentence(f, unit),
                        usable ? report::Level::info : report::Level::warning});
  page.add(report::KeyFigures{{{"usable to", {f.usable_to_hz, 4}, "Hz"},
                               {"gain", {f.low_gain, 4}, unit},
                               {"constant within 5 % to", {f.constant_to_hz, 4}, "Hz"},
                               {"late by", {1e3 * f.late_s, 3}, "ms"},
                               {"segments", {static_cast<double>(f.segments), 6}, ""}}});
  report::PlotGroup group{"Gain, phase and coherence", {}};
  report::Plot gain, phase, coherence;
  gain.caption = "Pale: bands of 95 %, each line by itself.";
  gain.x_label = "frequency", gain.x_unit = "Hz";
  for (report::Plot* plot : {&gain, &phase, &coherence}) {
    plot->log_x = true;
    if (usable) plot->spans = {{f.usable_from_hz, f.usable_to_hz, "usable", report::Level::info}};
  }
  gain.y_label = "gain", gain.log_y = true;
  gain.series = {transfer_curve("low", unit, f, f.gain_low, 1, true),
                 transfer_curve("high", unit, f, f.gain_high, 1, true),
                 transfer_curve("gain", unit, f, f.gain)};
  constexpr double kDegrees = 360 / kTwoPi;
  phase.y_label = "phase";
  phase.series = {transfer_curve("low", "deg", f, f.phase_low, kDegrees, true),
                  transfer_curve("high", "deg", f, f.phase_high, kDegrees, true),
                  transfer_curve("phase", "deg", f, f.phase_rad, kDegrees)};
  const std::vector<double> turns = whole_turns(f.phase_rad);
  for (report::Series& s : phase.series)
    for (std::size_t m = 0; m < s.y.size(); ++m) s.y[m] += kDegrees * turns[m];
  coherence.y_label = "coherence", coherence.y_range = {0, 1};
  coherence.series = {transfer_curve("coherence", "", f, f.coherence)};
  coherence.limits = {{0.9, "usable above", report::Level::info}};
  group.plots = {std::move(gain), std::move(phase), std::move(coherence)};
  page.add(std::move(group));
  for (const std::string& remark : f.remarks) page.add(report::Paragraph{remark + "."});
  return page.write(path);
}

void print_transfer_json(const Arguments& arguments, const TransferFunction& f,
                         const std::string& unit) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("input", arguments.at("--input"));
  json.member("output", arguments.at("--output"));
  json.member("gain_unit", unit);
  if (f.usable_to_hz > 0) {
    json.member("usable_from_hz", f.usable_from_hz);
    json.member("usable_to_hz", f.usable_to_hz);
  } else {
    json.member("usable_from_hz", nullptr);
    json.member("usable_to_hz", nullptr);
  }
  json.objects("coherent_bands", f.coherent_bands_hz, [&](const auto& band) {
    json.member("from_hz", band.first);
    json.member("to_hz", band.second);
  });
  json.member("low_gain", f.low_gain);
  json.member("constant_to_hz", f.constant_to_hz);
  json.member("late_s", f.late_s);
  json.member("shift_s", f.shift_s);
  json.member("segments", f.segments);
  json.member("segment_s", f.segment_s);
  json.member("resampled_to_closed", f.resampled_to_closed);
  json.member("records_disagree", f.records_disagree);
  json.member("widened_by", f.widened_by);
  json.member("segment_bias", f.segment_bias);
  json.member("input_noise_share", f.input_noise_share);
  each_column(
      f, [&](const char* name, const std::vector<double>& values) { json.values(name, values); });
  json.values("gain_resampled_low", f.gain_resampled_low);
  json.values("gain_resampled_high", f.gain_resampled_high);
  json.values("remarks", f.remarks);
  json.end_object();
  std::cout << '\n';
}

int run_identify_transfer(const Arguments& arguments) {
  TransferOptions options;
  options.input = arguments.at("--input");
  options.output = arguments.at("--output");
  if (options.input == options.output)
    return fail(usage_error("--input and --output are the same column; give two"));
  const auto segment = arguments.positive("--segment-s");
  if (!segment) return fail(segment.error());
  options.segment_s = segment->value_or(0);
  const auto noise = arguments.positive("--input-noise");
  if (!noise) return fail(noise.error());
  options.input_noise = noise->value_or(0);
  Progress progress("reading", arguments.quiet());
  const auto records = read_transfer_records(arguments, progress);
  if (!records) return fail(records.error());
  const auto f = identify_transfer(*records, options);
  if (!f) return fail(f.error());
  const std::string unit = gain_unit(options.input, options.output);
  if (const auto out = arguments.value("--out"))
    if (auto done = write_file(*out, transfer_csv(*f)); !done) return fail(done.error());
  if (const auto page = arguments.value("--report"))
    if (auto done = write_transfer_page(*page, arguments, *f, unit); !done)
      return fail(done.error());
  if (!arguments.quiet())
    for (const std::string& remark : f->remarks) note(remark);
  if (arguments.json()) {
    print_transfer_json(arguments, *f, unit);
    return 0;
  }
  say("%s\n", transfer_sentence(*f, unit).c_str());
  say("  %zu segments of %.4g s; bands by resampling %.2f times as wide as those of the closed "
      "form\n",
      f->segments, f->segment_s, f->resampled_to_closed);
  return 0;
}

}  // namespace

Program identify_transfer_program() {
  return {{"identify transfer",
           "gain, phase and coherence from one recorded signal to another",
           {{.name = "--trace",
             .value = "FILE",
             .meaning = "trace with both columns; several are merged",
             .required = true,
             .use = FileUse::input,
             .repeated = true},
            {"--input", "COLUMN", "what acts, as dyno.torque_Nm", true},
            {"--output", "COLUMN", "what follows, as spindle.current_A", true},
            {.name = "--estimates",
             .value = "FILE",
             .meaning = "estimates of that trace by 'monitor', for columns as x.force_N",
             .use = FileUse::input,
             .repeated = true},
            {"--segment-s", "SECONDS", "length of a segment; chosen when not given"},
            {"--input-noise", "VALUE", "standard deviation of noise on the input, in its unit"},
            {"--out", "FILE", "table of the transfer function, CSV", false, FileUse::output},
            {"--report", "FILE", "HTML page with its pictures", false, FileUse::output}},
           "",
           "Record something that excites the whole band, with sign: a cut that begins and ends, a "
           "speed that\n"
           "varies. Teeth that pass at one speed excite a few lines only, which is refused. Bands "
           "are of 95 %."},
          run_identify_transfer};
}

}  // namespace servosense::cli
