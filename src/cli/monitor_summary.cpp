#include "monitor_summary.hpp"

#include <cmath>
#include <cstdio>
#include <iostream>

#include "console.hpp"
#include "effort_unit.hpp"
#include "pair_watches.hpp"
#include "servosense/io/json.hpp"
#include "servosense/monitors/event_text.hpp"
#include "servosense/monitors/machine_stack.hpp"

namespace servosense::cli {
namespace {

void print_alarms(const MonitorRun& run) {
  std::size_t shown = 0;
  for (const Event& e : run.events) {
    if (e.state != MonitorState::alarm && e.state != MonitorState::warning) continue;
    if (++shown > 20) {
      say("  ... (--events FILE writes all of them)\n");
      break;
    }
    // A ratio has no unit to print.
    say("  %10.4f s  %-7s  %-14s  %-8s  %.3g%s%s (threshold %.3g): %s\n", e.t_s, name_of(e.state),
        name_of(e.monitor), e.channel.c_str(), e.value, e.unit == "1" ? "" : " ",
        e.unit == "1" ? "" : e.unit.c_str(), e.threshold, e.reason.c_str());
  }
}

void print_pairs(const MonitorRun& run) {
  for (const PairRun& pair : run.pairs)
    say("  pair %-11s of %-6s  %s: %s\n", std::string(name_of(pair.plan.kind)).c_str(),
        std::string(name_of(pair.channel)).c_str(), pair.plan.runs ? "runs" : "does not run",
        pair.plan.reason.c_str());
}

void write_pair(JsonWriter& json, const PairRun& pair) {
  json.member("channel", std::string_view(name_of(pair.channel)));
  json.member("pair", name_of(pair.plan.kind));
  json.member("runs", pair.plan.runs);
  json.member("reason", pair.plan.reason);
  json.member("unit", pair.unit);
  json.member("band", pair.plan.runs ? pair.plan.config.band : std::nan(""));
  json.member("largest", pair.plan.runs ? pair.largest : std::nan(""));
  json.member("watched_s", pair.watched_s);
}

void write_sees_from(JsonWriter& json, const SeesFrom& s) {
  json.key("sees_from");
  json.begin_object();
  json.member("value", s.value);
  json.member("unit", s.unit);
  if (s.frequency_hz) json.member("frequency_hz", *s.frequency_hz);
  if (s.in_cut) json.member("in_cut", *s.in_cut);
  json.member("blind", s.blind);
  json.end_object();
}

void write_advice(JsonWriter& json, const ChatterAdviceResult& advice) {
  const ChatterLine& line = advice.line;
  const bool told = line.verdict == ChatterLineVerdict::told;
  json.member("chatter_hz", told ? line.frequency_hz : std::nan(""));
  json.member("chatter_standard_error_hz", told ? line.standard_error_hz : std::nan(""));
  json.values("candidates_hz", line.candidates_hz);
  json.values("speeds_rpm", advice.speeds_rpm);
  json.member("speeds_uncertainty_rpm",
              advice.speeds_rpm.empty() ? std::nan("") : advice.speed_step_rpm);
}

}  // namespace

void print_summary(const MonitorRun& run) {
  say("Verdict: %s. %s\n", name_of(run.verdict.word), run.verdict.sentence.c_str());
  print_alarms(run);
  say("\n");
  say("%s on %s\n%.3f s at %.6g Hz, %llu samples", run.trace.c_str(), run.machine.c_str(),
      run.to_s - run.from_s, 1 / run.sample_period_s, static_cast<unsigned long long>(run.rows));
  if (run.missing > 0) say(", %llu missing", static_cast<unsigned long long>(run.missing));
  if (run.worst_jitter_s > 0) say(", jitter up to %.3g us", 1e6 * run.worst_jitter_s);
  say("\n");
  for (const std::string& note : run.notes) say("  %s\n", note.c_str());
  if (run.latency.count() > 0)
    say("  from servo instant to verdict: %.0f us in the median, 99 %% within %.0f us, 99.9 %% "
        "within "
        "%.0f us, at most %.0f us; %llu took longer than a period\n",
        1e-3 * static_cast<double>(run.latency.quantile_ns(0.5)),
        1e-3 * static_cast<double>(run.latency.quantile_ns(0.99)),
        1e-3 * static_cast<double>(run.latency.quantile_ns(0.999)),
        1e-3 * static_cast<double>(run.latency.greatest_ns()),
        static_cast<unsigned long long>(run.latency.overruns()));
  say("\n");
  for (const DriveHistory& drive : run.drives)
    say("  %-8s largest estimated %s %.4g %s\n", std::string(name_of(drive.channel)).c_str(),
        is_turning(drive.channel) ? "torque" : "force", drive.estimate.largest_magnitude(),
        drive.unit.c_str());
  for (const ConstantWatch::Finding& f : run.constants)
    say("  %-8s effort per acceleration %+.2g +- %.1g %% off the machine file, friction %+.3g %s\n",
        std::string(name_of(f.channel)).c_str(), 100 * f.drift.drift, 100 * f.drift.standard_error,
        f.drift.friction, is_turning(f.channel) ? "Nm" : "N");
  say("\n");
  print(run.coefficients);
  for (std::size_t i = 0; i < run.plan.monitors.size(); ++i) {
    const MonitorAvailability& m = run.plan.monitors[i];
    say("  %-14s on %-8s  %s: %s\n", name_of(m.monitor), std::string(name_of(m.channel)).c_str(),
        m.runs ? "runs" : "does not run", m.reason.c_str());
    if (m.runs && !run.watched[i].why.empty())
      say("  %-14s    %-8s  %s\n", "", "", run.watched[i].why.c_str());
    if (run.watched[i].faulty_samples > 0)
      say("  %-14s    %-8s  %llu faulty samples\n", "", "",
          static_cast<unsigned long long>(run.watched[i].faulty_samples));
  }
  print_pairs(run);
}

void print_monitor_json(const MonitorRun& run) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("trace", run.trace);
  json.member("machine", run.machine);
  json.member("sample_rate_hz", 1 / run.sample_period_s);
  json.member("from_s", run.from_s);
  json.member("to_s", run.to_s);
  json.member("samples", run.rows);
  json.member("missing_samples", run.missing);
  json.member("worst_jitter_s", run.worst_jitter_s);
  json.member("verdict", name_of(run.verdict.word));
  json.member("verdict_sentence", run.verdict.sentence);
  json.member("alarms", run.alarms);
  json.member("warnings", run.warnings);
  if (run.latency.count() > 0) {
    json.key("latency");
    json.begin_object();
    json.member("median_s", seconds_from(run.latency.quantile_ns(0.5)));
    json.member("p99_s", seconds_from(run.latency.quantile_ns(0.99)));
    json.member("p999_s", seconds_from(run.latency.quantile_ns(0.999)));
    json.member("greatest_s", seconds_from(run.latency.greatest_ns()));
    json.member("overruns", run.latency.overruns());
    json.end_object();
  }
  if (run.stop) {
    json.key("feed_hold");
    json.begin_object();
    json.member("asked", run.stop->events);
    json.member("acknowledged", run.stop->held);
    json.member("seen", run.stop->seen);
    json.member("overdue", run.stop->overdue);
    json.member("released", run.stop->released);
    json.member("tries", run.stop->tries);
    if (run.stop->held > 0) {
      json.member("median_s", seconds_from(run.stop->reaction.quantile_ns(0.5)));
      json.member("p99_s", seconds_from(run.stop->reaction.quantile_ns(0.99)));
      json.member("greatest_s", seconds_from(run.stop->reaction.greatest_ns()));
    }
    json.end_object();
  }
  json.objects("estimates", run.drives, [&](const DriveHistory& drive) {
    json.member("channel", std::string_view(name_of(drive.channel)));
    json.member("largest", drive.estimate.largest_magnitude());
    json.member("unit", drive.unit);
  });
  json.objects("constants", run.constants, [&](const ConstantWatch::Finding& f) {
    json.member("channel", std::string_view(name_of(f.channel)));
    json.member("drift", f.drift.drift);
    json.member("standard_error", f.drift.standard_error);
    json.member("pairs", f.drift.pairs);
    json.member("beyond", f.drift.beyond);
    json.member("step", f.drift.step);
    json.member(is_turning(f.channel) ? "friction_change_Nm" : "friction_change_N",
                f.drift.friction);
  });
  if (!run.coefficients.empty())
    json.objects("coefficients", run.coefficients,
                 [&](const FoundCoefficient& found) { write(json, found); });
  json.key("monitors");
  json.begin_array();
  for (std::size_t i = 0; i < run.plan.monitors.size(); ++i) {
    const MonitorAvailability& m = run.plan.monitors[i];
    json.begin_object();
    json.member("name", name_of(m.monitor));
    json.member("channel", std::string_view(name_of(m.channel)));
    json.member("runs", m.runs);
    json.member("reason", m.reason);
    json.member("watched_s", run.watched[i].armed_s);
    if (m.monitor == MonitorId::signal)
      json.member("faulty_samples", run.watched[i].faulty_samples);
    if (!run.watched[i].why.empty()) json.member("not_watched", run.watched[i].why);
    if (m.sees_from) write_sees_from(json, *m.sees_from);
    json.end_object();
  }
  json.end_array();
  if (!run.pairs.empty())
    json.objects("pairs", run.pairs, [&](const PairRun& pair) { write_pair(json, pair); });
  if (!run.advice.empty()) {
    json.key("advice");
    json.begin_object();
    json.member("t_s", run.events[run.advice.back().event].t_s);
    write_advice(json, run.advice.back());
    json.end_object();
  }
  json.key("events");
  json.begin_array();
  auto advice = run.advice.begin();
  for (std::size_t i = 0; i < run.events.size(); ++i) {
    if (advice == run.advice.end() || advice->event != i) {
      write_event(json, run.events[i]);
      continue;
    }
    write_event(json, run.events[i], [&] {
      json.key("advice");
      json.begin_object();
      write_advice(json, *advice);
      json.end_object();
    });
    ++advice;
  }
  json.end_array();
  if (run.reference)
    json.objects("reference", *run.reference, [&](const ReferenceVerdict& v) {
      json.member("from_s", v.from_s);
      json.member("to_s", v.to_s);
      json.member("distance", v.distance.value_or(std::nan("")));
      json.member("threshold", run.reference_threshold);
    });
  json.key("remarks");
  json.begin_array();
  for (const std::string& remark : run.plan.remarks) json.value(remark);
  for (const std::string& note : run.notes) json.value(note);
  json.end_array();
  json.values("not_written", run.not_written);
  json.end_object();
  std::cout << '\n';
}

}  // namespace servosense::cli
