// servosense pockets: stable spindle speeds from one or two decelerating cuts.
#include <cmath>
#include <cstdio>
#include <iostream>
#include <utility>

#include "commands.hpp"
#include "console.hpp"
#include "cut_evidence.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/short_time_fourier.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/identify/ramp_cuts.hpp"
#include "servosense/identify/stable_speeds.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/report.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/io/unit_watch.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/machine_config.hpp"
#include "servosense/sim/simulation_config.hpp"
#include "signed_samples.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {
namespace {

const char* name_of(StableSpeedVerdict verdict) {
  switch (verdict) {
    case StableSpeedVerdict::found:
      return "found";
    case StableSpeedVerdict::insufficient_chatter:
      return "insufficient-chatter";
    case StableSpeedVerdict::hidden:
      return "hidden";
    case StableSpeedVerdict::unclear:
      break;
  }
  return "unclear";
}

/// Speed from the column, or from the angle or its counts by differences.
Expected<std::vector<double>> speed_of(const Trace& trace, const MachineFile& machine,
                                       const std::string& path) {
  const Channel spindle = tool_spindle(machine);
  const std::string name(name_of(spindle));
  if (const auto* speed = trace.find({spindle, Quantity::speed_rad_s})) return *speed;
  const auto* angle = trace.find({spindle, Quantity::angle_rad});
  double unit = 1;
  if (angle == nullptr) {
    angle = trace.find({spindle, Quantity::angle_counts});
    if (angle == nullptr)
      return data_error(path + ": no " + name + ".speed_rad_s, angle_rad or angle_counts beside " +
                        name + ".torque_Nm; record one of them");
    auto counts = machine.required_number(name, "encoder_counts_per_rev");
    if (!counts) return counts.error();
    unit = kTwoPi / *counts;
  }
  std::vector<double> speed(angle->size(), 0.0);
  for (std::size_t i = 1; i < speed.size(); ++i) {
    double step = (*angle)[i] - (*angle)[i - 1];
    // A counter of 32 bits that has run over.
    if (unit != 1 && std::abs(step) > 0x1p31) step -= std::copysign(0x1p32, step);
    speed[i] = unit * step / (trace.t_s[i] - trace.t_s[i - 1]);
  }
  if (speed.size() > 1) speed[0] = speed[1];
  return speed;
}

/// Torque that the trace carries.
Expected<CuttingTorqueTrace> recorded_torque(const Trace& trace, const MachineFile& machine,
                                             const std::string& path) {
  CuttingTorqueTrace cut;
  if (trace.size() < 2) return data_error(path + ": there is no cut in it");
  // The mean: single times may be rounded.
  cut.sample_rate_hz =
      static_cast<double>(trace.size() - 1) / (trace.t_s.back() - trace.t_s.front());
  for (std::size_t i = 1; i < trace.t_s.size(); ++i)
    if (std::abs((trace.t_s[i] - trace.t_s[i - 1]) * cut.sample_rate_hz - 1) > 0.5)
      return data_error(path + ": a row is missing at " + std::to_string(trace.t_s[i]) +
                        " s; record the cut without gaps");
  cut.torque_Nm = *trace.find({tool_spindle(machine), Quantity::torque_Nm});
  auto speed = speed_of(trace, machine, path);
  if (!speed) return speed.error();
  cut.spindle_speed_rad_s = std::move(*speed);
  return cut;
}

/// Torque from current and angle.
Expected<CuttingTorqueTrace> observed_torque(const MachineFile& machine, TraceReader reader,
                                             const std::string& path, Progress& progress) {
  auto source = open_trace(std::move(reader), path, machine);
  if (!source) return source.error();
  auto plan = plan_stack(machine, signals_of(*source));
  if (!plan) return plan.error();
  const HostDriveSlotConfig& slot = plan->config.spindle;
  if (!slot.present)
    return data_error(path + ": neither " + std::string(name_of(plan->tool_spindle)) +
                      ".torque_Nm nor its current and angle are there; record one or the other");
  // The torque over the whole band: what an observer takes off the noise is weighed later.
  DriveInput<double> input;
  input.configure(slot.input);
  const double period = source->sample_period_s();
  const DriveModelConfig& drive = slot.monitor_observer.drive;
  CuttingTorqueTrace cut;
  cut.sample_rate_hz = 1 / period;
  if (slot.input.kind == MotionKind::counts)
    cut.count_torque_Nm = drive.inertia * slot.input.unit_per_count / (period * period);
  DriveSample<double> before;
  SignedSamples samples(*source, machine, *plan);
  MachineServoSample sample;
  bool first = true;
  for (std::size_t n = 1;; ++n) {
    auto more = samples.next(sample);
    if (!more) return more.error();
    if (!*more) break;
    if (n % 4096 == 0) progress.show(source->reader().progress());
    const DriveSample<double> now = input.process(sample.drive(plan->tool_spindle));
    if (has(now.quality, Quality::gap)) {
      if (first) continue;
      return data_error(path + ": the spindle's signals have a gap at " +
                        std::to_string(seconds_from(sample.t_ns)) +
                        " s; record the cut without gaps");
    }
    if (!first) {
      // At the sample before: efforts and motion on either side of it.
      const double speed = (before.increment + now.increment) / (2 * period);
      const double inertia =
          -drive.inertia * (now.increment - before.increment) / (period * period);
      const double friction =
          drive.viscous * speed + std::copysign(speed != 0 ? drive.coulomb : 0, speed);
      cut.spindle_speed_rad_s.push_back(speed);
      cut.inertia_torque_Nm.push_back(inertia);
      cut.torque_Nm.push_back(before.effort + inertia - friction);
    }
    before = now;
    first = false;
  }
  return cut;
}

Expected<CuttingTorqueTrace> read_cut(const MachineFile& machine, const std::string& path,
                                      Progress& progress) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  if (!reader->column({tool_spindle(machine), Quantity::torque_Nm}))
    return observed_torque(machine, std::move(*reader), path, progress);
  auto trace = read_trace(*reader);
  if (!trace) return trace.error();
  if (auto done = check_units(*trace, column_choices(machine), path); !done) return done.error();
  return recorded_torque(*trace, machine, path);
}

report::HeatMap spectrogram_of(const CuttingTorqueTrace& cut, const ChatterRidge& ridge,
                               const StableSpeeds& found) {
  report::HeatMap map;
  map.title = "Spectrogram of the cutting torque";
  map.x_label = "time";
  map.x_unit = "s";
  map.y_label = "frequency";
  map.y_unit = "Hz";
  map.z_label = "power";
  map.z_unit = "dB";
  map.caption =
      "Power in dB below its highest, Hann window. Sloping lines are harmonics of the tooth "
      "passing; points are the chatter; marks are the stable speeds.";
  const std::size_t n = cut.torque_Nm.size();
  ShortTimeFourierConfig config;
  config.window = 256;
  config.hop = std::max<std::size_t>(32, n / 240);
  auto spectrogram = short_time_fourier(cut.torque_Nm, cut.sample_rate_hz, config);
  if (!spectrogram || spectrogram->frames() < 2) return map;
  const double half_hop = 0.5 * static_cast<double>(config.hop) / cut.sample_rate_hz;
  for (const double t : spectrogram->t_s) map.x_edges.push_back(t - half_hop);
  map.x_edges.push_back(spectrogram->t_s.back() + half_hop);
  const double half_line = 0.5 * spectrogram->frequency_hz[1];
  for (const double f : spectrogram->frequency_hz) map.y_edges.push_back(f - half_line);
  map.y_edges.push_back(spectrogram->frequency_hz.back() + half_line);
  double highest = 0;
  for (const double p : spectrogram->power) highest = std::max(highest, p);
  for (std::size_t k = 0; k < spectrogram->lines(); ++k)
    for (std::size_t f = 0; f < spectrogram->frames(); ++f)
      map.z.push_back(std::max(-80.0, 10 * std::log10(spectrogram->at(f, k) / highest)));
  report::Series chatter;
  chatter.name = "chatter";
  chatter.unit = "Hz";
  chatter.style = report::Series::Style::points;
  chatter.x = ridge.t_s;
  chatter.y = ridge.frequency_hz;
  map.contours.push_back(std::move(chatter));
  for (const StableSpeed& p : found.pockets) {
    std::size_t nearest = 0;
    for (std::size_t i = 0; i < ridge.t_s.size(); ++i)
      if (std::abs(ridge.spindle_speed_rpm[i] - p.spindle_speed_rpm) <
          std::abs(ridge.spindle_speed_rpm[nearest] - p.spindle_speed_rpm))
        nearest = i;
    if (nearest < ridge.t_s.size())
      map.marks.push_back({ridge.t_s[nearest],
                           std::to_string(std::lround(p.spindle_speed_rpm)) + " rpm",
                           report::Level::info});
  }
  return map;
}

Expected<Done> write_report(const std::string& path, const std::vector<std::string>& traces,
                            const std::vector<CuttingTorqueTrace>& cuts,
                            const StableSpeeds& found) {
  std::string sources;
  for (const std::string& t : traces) sources += (sources.empty() ? "" : ", ") + t;
  report::Report page("Stable spindle speeds", sources);
  page.add(report::Note{found.sentence, found.verdict == StableSpeedVerdict::found
                                            ? report::Level::info
                                            : report::Level::warning});
  report::Table table{"Stable spindle speeds",
                      "The minimum is where the chatter power is smallest; it lags.",
                      {"speed [rpm]", "+- [rpm]", "minimum [rpm]", "spread of the cuts [rpm]"},
                      {}};
  for (const StableSpeed& p : found.pockets)
    table.rows.push_back({{report::Cell(p.spindle_speed_rpm, 5), report::Cell(p.uncertainty_rpm, 2),
                           report::Cell(p.minimum_rpm, 5), report::Cell(p.spread_rpm, 2)},
                          report::Level::none});
  if (!table.rows.empty()) page.add(std::move(table));
  for (std::size_t c = 0; c < found.ramps.size(); ++c) {
    const ChatterRidge& ridge = found.ridge[c];
    page.add(spectrogram_of(cuts[found.ramps[c].record], ridge, found));
    report::Plot plot;
    plot.title = "Chatter power against spindle speed";
    plot.caption = "Largest line, all sidebands together, and its moving average.";
    plot.x_label = "spindle speed";
    plot.x_unit = "rpm";
    plot.y_label = "power";
    plot.log_y = true;
    report::Series power{"chatter", "Nm2", ridge.spindle_speed_rpm, ridge.power_Nm2, {}};
    report::Series mean{"moving average", "Nm2", ridge.spindle_speed_rpm, ridge.average_Nm2, {}};
    plot.series = {std::move(power), std::move(mean)};
    for (const StableSpeed& p : found.pockets)
      plot.marks.push_back({p.spindle_speed_rpm, "stable speed", report::Level::info});
    for (const PowerMinimum& m : found.minima[c])
      plot.marks.push_back({m.spindle_speed_rpm, m.accepted ? "minimum" : "minimum, rejected",
                            report::Level::warning});
    page.add(std::move(plot));
  }
  return page.write(path);
}

void print_json(const StableSpeeds& found) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("verdict", std::string_view(name_of(found.verdict)));
  json.member("sentence", found.sentence);
  json.member("chatter_share", found.chatter_share);
  json.objects("stable_speeds", found.pockets, [&](const StableSpeed& p) {
    json.member("spindle_speed_rpm", p.spindle_speed_rpm);
    json.member("uncertainty_rpm", p.uncertainty_rpm);
    json.member("minimum_rpm", p.minimum_rpm);
    json.member("spread_rpm", p.spread_rpm);
  });
  json.objects("ramps", found.ramps, [&](const RampInCut& r) {
    json.member("cut", r.record + 1);
    json.member("from_s", r.from_s);
    json.member("to_s", r.to_s);
    json.member("fastest_rpm", r.fastest_rpm);
    json.member("slowest_rpm", r.slowest_rpm);
    json.member("chatter_share", r.chatter_share);
    json.member("used", r.used);
  });
  json.member("seen_below_hz", found.seen_below_hz);
  json.member("visible_torque_Nm", found.visible_torque_Nm);
  json.member("counts_factor", found.counts_factor);
  json.key("minima");
  json.begin_array();
  for (std::size_t c = 0; c < found.minima.size(); ++c)
    for (const PowerMinimum& m : found.minima[c]) {
      json.begin_object();
      json.member("cut", found.ramps[c].record + 1);
      json.member("t_s", m.t_s);
      json.member("spindle_speed_rpm", m.spindle_speed_rpm);
      json.member("power_Nm2", m.power_Nm2);
      json.member("accepted", m.accepted);
      json.end_object();
    }
  json.end_array();
  json.end_object();
  std::cout << '\n';
}

/// Adds what the ramps say of cuts to a file, and says how much that is.
Expected<Done> add_cuts(const std::string& path, const MillingCut& cut,
                        const std::vector<std::string>& traces, const StableSpeeds& found,
                        bool quiet) {
  WatchedCut engagement = watched_cut_of(cut);
  engagement.note = "ramp of " + traces.front() + (traces.size() > 1 ? ", " + traces[1] : "");
  const std::vector<WatchedCut> cuts = cuts_of_ramps(found, engagement);
  if (auto done = append_watched_cuts(path, cuts); !done) return done.error();
  if (cuts.empty())
    note("--cuts: no cut was written: no stable speeds were found", quiet);
  else
    note("--cuts: " + std::to_string(cuts.size()) +
             " chattering speeds written; whether the cut is stable at the speeds found, a cut "
             "there "
             "tells ('servosense monitor --cuts')",
         quiet);
  return Done{};
}

int run_pockets(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  auto teeth = machine->required_number("tool", "teeth");
  if (!teeth) return fail(teeth.error());
  StableSpeedOptions options;
  options.teeth = static_cast<int>(std::lround(*teeth));
  const auto nominal = milling_cut(*machine);
  if (const auto path = arguments.value("--cuts")) {
    if (!nominal) return fail(nominal.error());
    if (auto done = check_watched_cuts(*path); !done) return fail(done.error());
  }
  // Mean torque of the cut, from the chip volume of a turn.
  if (nominal)
    if (const auto tool = milling_tool(*machine);
        tool && nominal->direction != MillingDirection::slot)
      options.expected_torque_Nm = tool->force.tangential_coefficient_N_per_m2 *
                                   nominal->axial_depth_m * nominal->radial_immersion_m *
                                   nominal->feed_per_tooth_m * tool->teeth / kTwoPi;
  std::vector<std::string> traces = {arguments.at("--trace")};
  if (const auto second = arguments.value("--trace2")) traces.push_back(*second);
  std::vector<CuttingTorqueTrace> cuts;
  for (const std::string& path : traces) {
    Progress progress("reading", arguments.quiet());
    auto record = read_cut(*machine, path, progress);
    if (!record) return fail(record.error());
    cuts.push_back(std::move(*record));
  }
  auto found = [&] {
    Progress progress("looking for chatter", arguments.quiet());
    options.progress = [&](double share) { progress.show(share); };
    return identify_stable_speeds(cuts, options);
  }();
  if (!found) return fail(found.error());
  if (const auto path = arguments.value("--cuts"))
    if (auto done = add_cuts(*path, *nominal, traces, *found, arguments.quiet()); !done)
      return fail(done.error());
  if (const auto page = arguments.value("--report"))
    if (auto done = write_report(*page, traces, cuts, *found); !done) return fail(done.error());
  if (arguments.json()) {
    print_json(*found);
    return 0;
  }
  say("%s\n", found->sentence.c_str());
  for (const StableSpeed& p : found->pockets) {
    say("  %8.0f +- %-4.0f rpm", p.spindle_speed_rpm, p.uncertainty_rpm);
    if (std::isfinite(p.minimum_rpm)) say("  (power smallest at %.0f rpm)", p.minimum_rpm);
    say("\n");
  }
  if (found->pockets.empty())
    for (const auto& cut : found->minima)
      for (const PowerMinimum& m : cut)
        if (m.accepted) say("  power smallest at %.0f rpm\n", m.spindle_speed_rpm);
  return 0;
}

}  // namespace

Program pockets_program() {
  return {
      {"pockets",
       "stable spindle speeds from one cut with falling spindle speed",
       {{"--machine", "FILE", "machine file with [tool] teeth, and the spindle", true,
         FileUse::input},
        {"--trace", "FILE", "trace of a cut that chatters while the speed falls", true,
         FileUse::input},
        {"--trace2", "FILE", "the same cut once more, at another rate", false, FileUse::input},
        {"--cuts", "FILE",
         "add the speeds at which the ramps chattered, for 'servosense recommend --cuts'", false,
         FileUse::output},
        {"--report", "FILE", "HTML page with the spectrogram and the stable speeds", false,
         FileUse::output}},
       "",
       "Choose a cut deep enough to chatter at nearly every speed, and let the speed override "
       "fall steadily,\n"
       "15 to 50 % a second, feed per tooth kept. Run-up, air and run-down may be in the record, "
       "and several\n"
       "such cuts. Torque comes from spindle.torque_Nm (cutting torque), else from current and "
       "angle."},
      run_pockets};
}

}  // namespace servosense::cli
