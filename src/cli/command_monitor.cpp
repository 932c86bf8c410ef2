// servosense monitor: the main job.
#include <sys/time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <deque>
#include <future>
#include <iostream>
#include <memory>
#include <optional>
#include <utility>

#include "chatter_advice.hpp"
#include "commands.hpp"
#include "console.hpp"
#include "constant_watch.hpp"
#include "cut_evidence.hpp"
#include "effort_unit.hpp"
#include "known_torque.hpp"
#include "monitor_outputs.hpp"
#include "monitor_report.hpp"
#include "monitor_session.hpp"
#include "monitor_source.hpp"
#include "monitor_summary.hpp"
#include "override_watch.hpp"
#include "pair_watches.hpp"
#include "servosense/hal/host_clock.hpp"
#include "servosense/hal/privileges.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/monitors/event_text.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "servosense/monitors/stack_reach.hpp"
#include "shdr_sink.hpp"
#include "signed_samples.hpp"
#include "slow_chatter_watch.hpp"
#include "stack_signals.hpp"
#include "stop_sink.hpp"

namespace servosense::cli {
namespace {

constexpr std::size_t kHistogramValues = 200000;

void keep(DriveHistory& history, const HostStack::Drive& drive, double t_s, double value,
          double speed, std::uint64_t stride, std::uint64_t sample) {
  if (has(drive.quality, Quality::gap | Quality::settling)) return;
  history.estimate.add(t_s, drive.estimate);
  history.spectrum.add(drive.estimate);
  history.value.add(t_s, value);
  history.speed.add(t_s, speed);
  if (sample % stride == 0 && history.values.size() < kHistogramValues)
    history.values.push_back(value);
}

void keep_all(MonitorRun& run, const MachineStack& stack, const KnownTorque& torque, double t_s,
              std::uint64_t stride) {
  for (DriveHistory& history : run.drives) {
    const Channel channel = history.channel;
    if (!torque.known(channel)) continue;
    const HostStack::Drive& drive = stack.drive(channel);
    const double own_speed = drive.sample.increment / run.sample_period_s;
    const double speed = is_turning(channel) ? rpm_from_rad_s(own_speed) : own_speed;
    if (is_spindle(channel)) {
      const auto& chatter = stack.stack_of(channel).chatter().state();
      keep(history, drive, t_s, chatter.chatter_Nm2, speed, stride, run.samples);
      if (!has(drive.quality, Quality::gap | Quality::settling))
        history.forced_power.add(t_s, chatter.forced_Nm2);
    } else {
      const auto& collision = stack.first().collision(axis_index(channel));
      keep(history, drive, t_s, collision.state().jerk_N_per_s, speed, stride, run.samples);
    }
  }
  for (ToolHistory& history : run.tool)
    if (history.monitor != MonitorId::reference) keep(history, stack.first(), t_s);
  keep(run.band, stack.first(), t_s);
  keep(run.coefficient_history, stack, t_s);
}

PairRun pair_run(const PairWatches::Pair& pair) {
  return {pair.channel, pair.plan, pair_unit(pair.plan.kind, pair.channel), pair.watch.largest(),
          pair.watch.watched_s()};
}

/// The remarks of a live source that has given no row.
std::string why_nothing(const MonitorRun& run) {
  std::string text;
  for (const std::string& remark : run.source_remarks)
    text += (text.empty() ? ": " : ", ") + remark;
  return text + "; see that it is on, and that address and map are its own";
}

std::atomic<bool> stop_requested{false};

// A live run ends in good order: files are closed, the report is written. What nohup has switched
// off stays off, and a reader of the events that goes away does not end the watch.
void stop_on_signals() {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    if (std::signal(signal, [](int) { stop_requested = true; }) == SIG_IGN && signal == SIGHUP)
      std::signal(signal, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
}

// A timer ends the run whatever its source does meanwhile.
void stop_after(double seconds) {
  constexpr double kLongest_s = 1e9;  // thirty years
  seconds = std::clamp(seconds, 1e-6, kLongest_s);
  itimerval timer{};
  timer.it_value.tv_sec = static_cast<time_t>(seconds);
  timer.it_value.tv_usec = static_cast<suseconds_t>(1e6 * (seconds - std::floor(seconds)));
  std::signal(SIGALRM, [](int) { stop_requested = true; });
  setitimer(ITIMER_REAL, &timer, nullptr);
}

/// What the friction of the spindle has been followed to.
std::string friction_followed(const FrictionFollowerConfig& file,
                              const FrictionFollower<double>::State& now) {
  char text[240];
  std::snprintf(text, sizeof text,
                "spindle: friction was followed over %u windows in the air: viscous %.4g Nm s/rad "
                "(machine file: %.4g), Coulomb %.4g Nm (%.4g)",
                now.followed, now.viscous, file.viscous, now.coulomb, file.coulomb);
  return text;
}

int run_monitor(const Arguments& arguments) {
  if (arguments.json() && arguments.value("--events") == "-")
    return fail(usage_error(
        "--json and '--events -' both want standard output; write the events to a file"));
  if (auto done = check_source(arguments); !done) return fail(done.error());
  if (auto done = StopSink::check(arguments); !done) return fail(done.error());
  const auto duration = arguments.positive("--duration");
  if (!duration) return fail(duration.error());
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  auto compared = ReferenceWatch::open(*machine);
  if (!compared) return fail(compared.error());
  ReferenceWatch& reference = **compared;
  PairWatches pairs(*machine);
  SensorWatches sensors(*machine);
  auto opened = open_source(arguments, *machine, stop_requested, reference, pairs, sensors);
  if (!opened) return fail(opened.error());
  give_up_privileges(Privileges::of_a_run);
  SampleSource* const source = &opened->samples;
  const std::string& trace_path = opened->name;
  if (opened->live || arguments.has("--pace")) stop_on_signals();
  if (*duration) stop_after(**duration);

  MonitorRun run;
  run.trace = trace_path;
  run.machine = machine->text("machine", "name").value_or(machine->name());
  run.sample_period_s = source->sample_period_s();
  if (const auto units = source->reader().meta("units")) run.notes.push_back("Units: " + *units);
  auto plan = plan_stack(*machine, signals_of(*source));
  if (!plan) return fail(plan.error());
  run.plan = std::move(*plan);
  reference.plan(run.sample_period_s, opened->live, run.plan);
  SlowChatterWatch slow(*machine, run.plan, run.sample_period_s);
  if (auto done = sensors.plan(run.sample_period_s, run.plan); !done) return fail(done.error());
  const double rate = 1 / run.sample_period_s;
  for (std::string& remark : opened->efforts->remarks())
    run.plan.remarks.push_back(std::move(remark));
  source->also_used(opened->efforts->used());
  source->also_used(pairs.columns());
  source->also_used(sensors.columns());
  if (!run.plan.torque_band.empty()) source->program_used();
  for (std::string& remark : source->column_remarks())
    run.plan.remarks.push_back(std::move(remark));
  for (const std::string& remark : run.plan.remarks) note(remark, arguments.quiet());

  EventSink events;
  EstimateSink estimates;
  if (auto done = events.open(arguments.value("--events"), opened->live); !done)
    return fail(done.error());
  if (auto done = estimates.open(arguments.value("--estimates"), *machine, run.plan, trace_path,
                                 opened->live);
      !done)
    return fail(done.error());
  OutputWatch outputs;
  outputs.add(events.failure());
  if (estimates.writer() != nullptr) outputs.add(estimates.writer()->failure());
  if (opened->record) outputs.add(opened->record->failure());

  ShdrSink shdr;
  if (auto done = shdr.open(arguments, run.plan, run.machine); !done) return fail(done.error());

  MachineStack stack(run.plan);
  for (const Channel channel : kDriveChannels) {
    if (run.plan.slot_of(channel) == nullptr) continue;
    run.drives.emplace_back(channel, effort_unit(*machine, channel), rate);
    const HostStackConfig& config = run.plan.stack_of(channel);
    run.drives.back().threshold =
        is_spindle(channel) ? config.spindle.chatter.chatter_threshold_Nm2
                            : config.axis[axis_index(channel)].collision.threshold_N_per_s;
  }

  WatchTally tally(*machine, source->reader().signals(), run.plan);
  run.tool = tool_histories(run.plan);
  if (reference.runs()) run.tool.push_back(reference_history());
  run.teeth = static_cast<unsigned>(machine->number("tool", "teeth").value_or(0));
  for (const char* key : {"start", "date", "recorded"})
    if (const auto when = source->reader().meta(key); when && run.recorded.empty())
      run.recorded = *when;

  StackReach reach(*machine, run.plan, run.sample_period_s);
  ChatterAdvice advice(*machine, run.plan);
  std::optional<OverrideWatch> overrides;
  if (arguments.has("--cnc")) {
    auto watch = OverrideWatch::open(*machine, run.plan, advice, arguments.value("--commands"),
                                     opened->live);
    if (!watch) return fail(watch.error());
    overrides = std::move(*watch);
  }
  StopSink stop;
  if (auto done = stop.open(arguments, overrides.has_value()); !done) return fail(done.error());
  std::optional<CutEvidence> evidence;
  if (const auto path = arguments.value("--cuts")) {
    if (auto done = check_watched_cuts(*path); !done) return fail(done.error());
    auto cuts = CutEvidence::create(*machine, run.plan, run.sample_period_s);
    if (!cuts) return fail(cuts.error());
    evidence = std::move(*cuts);
  }
  std::deque<std::future<ChatterAdviceResult>> advised;
  const auto look_into = [&](std::optional<ChatterStretch> stretch) {
    if (!stretch) return;
    advised.push_back(std::async(opened->live ? std::launch::async : std::launch::deferred,
                                 [&advice, live = opened->live, heard = std::move(*stretch)] {
                                   if (live) leave_real_time();
                                   return advice.look_into(heard);
                                 }));
  };
  // A live run does not wait: monitors go on.
  const auto advise = [&](bool wait) {
    while (!advised.empty()) {
      if (!wait && advised.front().wait_for(std::chrono::seconds(0)) == std::future_status::timeout)
        return;
      ChatterAdviceResult result = advised.front().get();
      advised.pop_front();
      run.events[result.event].reason += result.reason;
      if (opened->live && !arguments.quiet()) note("chatter" + result.reason);
      const double hz = result.line.frequency_hz;
      const bool known =
          std::any_of(run.chatter_hz.begin(), run.chatter_hz.end(),
                      [&](double other) { return std::abs(other - hz) < 0.01 * hz; });
      if (result.line.verdict == ChatterLineVerdict::told && !known) run.chatter_hz.push_back(hz);
      run.advice.push_back(std::move(result));
    }
  };
  KnownTorque known_torque(run.plan, *source);
  ConstantWatch constants(*machine, run.plan);
  run.latency.watch(nanoseconds_from(run.sample_period_s));
  if (arguments.has("--realtime"))
    if (const std::string remark = ask_for_real_time(50).remark; !remark.empty()) {
      run.notes.push_back(remark);
      if (!arguments.quiet()) note(remark);
    }
  SignedSamples samples(*source, *machine, run.plan);
  Progress progress("monitoring", arguments.quiet());
  MachineServoSample sample;
  bool first = true;
  const auto stride = static_cast<std::uint64_t>(std::max(1.0, rate / 1000));
  const auto tell_event = [&](const Event& event, Nanoseconds t_ns) {
    stop.change(event.monitor, event.state);
    events.write(event);
    shdr.event(t_ns, event);
    if (run.events.size() < MonitorRun::kMostEvents) run.events.push_back(event);
    ++run.event_count;
    if (event.state == MonitorState::alarm) ++run.alarms;
    if (event.state == MonitorState::warning) ++run.warnings;
  };
  const auto tell = [&](const StateChange<double>& change, const Event& event, Nanoseconds t_ns) {
    tally.change(change, seconds_from(t_ns));
    if (overrides) overrides->change(change);
    // Which speeds are better is known of a milling tool.
    if (change.monitor == MonitorId::chatter && change.channel == run.plan.tool_spindle &&
        change.state == MonitorState::alarm && !slow.takes(change.channel) &&
        run.events.size() < MonitorRun::kMostEvents)
      advice.alarm(run.events.size(), change);
    if (evidence && change.state == MonitorState::alarm)
      evidence->alarm(change.monitor, change.channel, run.events.size());
    tell_event(event, t_ns);
  };
  for (;;) {
    auto more = samples.next(sample);
    if (!more && !opened->live) return fail(more.error());
    // What was seen until then is told all the same.
    if (!more) run.broke_off = more.error();
    if (!more || !*more) break;
    stop.arrived();
    const double t_s = seconds_from(sample.t_ns);
    if (first) run.from_s = t_s;
    first = false;
    run.to_s = t_s;
    const auto changes = stack.process(sample);
    tally.sample(t_s, stack);
    for (const StateChange<double>& change : changes)
      tell(change, event_from(change, sample.t_ns), sample.t_ns);
    for (const auto& [change, event] : reference.changes(t_s)) tell(change, event, sample.t_ns);
    pairs.hear(stack, run.plan);
    for (const Event& event : pairs.events(t_s)) tell_event(event, sample.t_ns);
    for (const auto& [change, event] : slow.sample(t_s, stack)) tell(change, event, sample.t_ns);
    for (const auto& [change, event] : sensors.sample(sample.t_ns, samples.recorded(), stack))
      tell(change, event, sample.t_ns);
    if (overrides) overrides->sample(t_s, stack, stop, arguments.quiet());
    reach.heard(sample, stack);
    if (evidence) evidence->sample(t_s, stack);
    look_into(advice.add(stack.stack_of(run.plan.tool_spindle)));
    advise(false);
    ++run.samples;
    if (samples.recorded()) ++run.rows;
    if (opened->live && samples.recorded()) run.latency.add(host_now_ns() - sample.t_ns);
    known_torque.sample(stack, samples.recorded());
    for (const auto& [change, event] : opened->efforts->changes(t_s))
      tell(change, event, sample.t_ns);
    for (const auto& [change, event] : constants.sample(t_s, stack, known_torque))
      tell(change, event, sample.t_ns);
    keep_all(run, stack, known_torque, t_s, stride);
    shdr.sample(sample.t_ns, stack);
    if (samples.recorded()) estimates.write(sample.t_ns, stack, known_torque);
    outputs.look();
    if (run.samples % 4096 == 0) progress.show(source->reader().progress());
  }
  for (const auto& [change, event] : reference.finish(run.to_s)) tell(change, event, sample.t_ns);
  for (const Event& event : pairs.events(HUGE_VAL)) tell_event(event, sample.t_ns);
  for (const PairWatches::Pair& pair : pairs.pairs()) run.pairs.push_back(pair_run(pair));
  if (machine->has("monitor.reference", "reference")) {
    run.reference = reference.runs() ? reference.verdicts() : std::vector<ReferenceVerdict>{};
    run.reference_threshold = reference.threshold();
  }
  for (ToolHistory& history : run.tool)
    if (history.monitor == MonitorId::reference) keep(history, run);
  if (const auto* follower = stack.follower()) {
    run.plan.remarks.push_back(friction_followed(*run.plan.follow, follower->state()));
    note(run.plan.remarks.back(), arguments.quiet());
  }
  reach.tell(run.plan);
  slow.tell(run.plan);
  sensors.tell(run.plan);
  reference.tell(run.plan);
  look_into(advice.finish());
  advise(true);
  const SourceHealth& time = source->health();
  run.missing = time.missing_samples;
  run.worst_jitter_s = time.worst_jitter_s;
  if (time.early > 0)
    run.notes.push_back(std::to_string(time.early) +
                        " row(s) came before a period had passed since the last; left out");
  if (time.untimed > 0)
    run.notes.push_back(std::to_string(time.untimed) +
                        " row(s) came at another rate, or with more jitter than tells which period "
                        "they belong to; not used");
  run.watched = tally.finish(run.plan, stack, run.sample_period_s);
  const std::size_t remarks = run.plan.remarks.size();
  known_torque.tell(run.plan, run.watched);
  run.constants = constants.findings();
  run.coefficients = found_coefficients(stack);
  if (run.plan.coefficients && run.plan.config.tool.wear_on)
    run.coefficient_history.worn_N_per_m2 =
        run.plan.config.tool.wear.specific_force_ratio * run.coefficient_history.taught_N_per_m2;
  for (std::string& remark : constants.remarks()) run.plan.remarks.push_back(std::move(remark));
  for (std::string& remark : samples.remarks()) run.plan.remarks.push_back(std::move(remark));
  for (std::string& remark : source->late_remarks()) run.plan.remarks.push_back(std::move(remark));
  if (!arguments.quiet())
    for (std::size_t i = remarks; i < run.plan.remarks.size(); ++i) note(run.plan.remarks[i]);
  for (std::size_t i = 0; i < run.plan.monitors.size(); ++i)
    if (const MonitorAvailability& m = run.plan.monitors[i]; m.monitor == MonitorId::signal)
      run.watched[i].faulty_samples = stack.health(m.channel).state().faults;
  run.verdict = verdict_of(run.plan, run.watched, run.alarms, run.warnings, run.to_s - run.from_s);
  const bool events_alone = arguments.value("--events") == "-";
  for (std::string& remark : source->reader().remarks()) {
    if (!opened->live && run.samples == 0) return fail(data_error(trace_path + ": " + remark));
    // What went wrong on the way is said even where the summary is left out.
    if (events_alone && !arguments.quiet()) note(remark);
    if (opened->live) run.source_remarks.push_back(remark);
    run.notes.push_back(std::move(remark));
  }
  run.stop = stop.close();
  if (run.stop) run.notes.push_back(stop_summary(*run.stop));
  if (overrides) run.notes.push_back(overrides->summary());
  const auto finish = [&](const Expected<Done>& done) {
    if (!done) run.not_written.push_back(done.error().sentence);
  };
  if (const auto path = arguments.value("--coefficients-out")) {
    const auto* monitor = stack.coefficients();
    const double turns = monitor != nullptr ? monitor->state().revolutions : 0;
    std::vector<std::string> said;
    finish(write_found_coefficients(*path, *machine, run.coefficients, trace_path,
                                    static_cast<std::uint64_t>(std::llround(turns)), said));
    for (std::string& remark : said) {
      note(remark, arguments.quiet());
      run.plan.remarks.push_back(std::move(remark));
    }
  }
  if (evidence) {
    CutEvidence::Told told = evidence->tell(run);
    finish(append_watched_cuts(arguments.at("--cuts"), told.cuts));
    for (std::string& remark : told.remarks) {
      note(remark, arguments.quiet());
      run.plan.remarks.push_back(std::move(remark));
    }
  }
  finish(events.close());
  if (overrides) finish(overrides->close());
  finish(estimates.close());
  if (opened->record) finish(opened->record->close());
  if (const auto page = arguments.value("--report")) finish(write_monitor_report(run, *page));
  if (arguments.json())
    print_monitor_json(run);
  else if (!events_alone)
    print_summary(run);
  int status = 0;
  for (const std::string& sentence : run.not_written) status = complain(device_error(sentence));
  if (run.broke_off) status = complain(*run.broke_off);
  if (opened->live && run.rows == 0 && !run.broke_off)
    status = complain(device_error(trace_path + ": nothing came from it" + why_nothing(run)));
  if (run.stop && stop_failed(*run.stop))
    status = complain(
        device_error("the CNC was asked for a feed hold and not seen to stand; see that it is "
                     "running and reached, and do not rely on it until then"));
  if (status != 0) return status;
  // A gate fails closed: where nothing watched, nothing is known.
  const bool failed = run.alarms > 0 || run.verdict.word == VerdictWord::not_watched;
  return failed && arguments.has("--fail-on-alarm") ? 1 : 0;
}

}  // namespace

Program monitor_program() {
  std::vector<Option> options = {{"--machine", "FILE", "machine file", true, FileUse::input}};
  for (Option& option : source_options()) options.push_back(std::move(option));
  options.insert(
      options.end(),
      {{"--events", "FILE|-", "write the events as JSON Lines, '-' to standard output", false,
        FileUse::output},
       {"--estimates", "FILE", "write estimated torque and force as a trace", false,
        FileUse::output},
       {"--coefficients-out", "FILE",
        "write the cutting coefficients that were found, for [tool] coefficients", false,
        FileUse::output},
       {"--cuts", "FILE", "add the cuts, stable or chattering, for 'servosense recommend --cuts'",
        false, FileUse::output},
       {"--report", "FILE", "write an HTML report", false, FileUse::output},
       {"--realtime", "", "lock memory and ask for SCHED_FIFO in a live run", false},
       {"--shdr", "PORT", "serve values and conditions to MTConnect agents", false},
       {"--shdr-address", "IP", "address to listen on instead of 127.0.0.1", false},
       {"--shdr-device", "FILE", "write the device file for the agent", false, FileUse::output},
       {"--cnc", "URL", "hold the feed of linuxcnc://HOST:5007 on an alarm; or 'simulated'", false},
       {"--commands", "FILE", "write what is commanded to the CNC as JSON Lines", false,
        FileUse::output},
       {"--stop-on", "LEVEL", "'alarm' (default) or 'warning'", false},
       {"--fail-on-alarm", "", "exit with status 1 when an alarm was raised or nothing was watched",
        false}});
  return {{"monitor", "estimate cutting force and torque and raise alarms", std::move(options), "",
           "Samples come from one of --trace, --candump, --can and --modbus. A live run ends with "
           "Ctrl-C.\n"
           "Thresholds come from the machine file; 'servosense identify idle' learns them from an "
           "idling\n"
           "run. What a monitor cannot do with these signals is said in the summary."},
          run_monitor};
}

}  // namespace servosense::cli
