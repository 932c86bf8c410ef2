#include "monitor_session.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "servosense/io/report.hpp"

namespace servosense::cli {
namespace {

using report::Level;

Level level_of(const std::string& state) {
  if (state == "alarm") return Level::alarm;
  if (state == "warning" || state == "signal-fault") return Level::warning;
  return Level::info;
}

std::string drive_title(Channel channel) {
  return channel == Channel::spindle ? "Spindle" : "Axis " + std::string(name_of(channel));
}

// Of what the monitor looks at: power of torque, rate of force.
std::string value_unit(const DriveHistory& drive) {
  return drive.unit + (drive.channel == Channel::spindle ? "2" : "/s");
}

report::Series series_of(const Envelope& envelope, std::string name, std::string unit) {
  report::Series s;
  s.name = std::move(name);
  s.unit = std::move(unit);
  envelope.points(s.x, s.y);
  return s;
}

// Alarms and warnings of one channel, each from its beginning to the next change of state. A few
// alarms are explained below the picture; many are left to the table of events.
void mark(const MonitorRun& run, Channel channel, bool explain, report::Plot& plot) {
  constexpr std::size_t kMostExplained = 8;
  std::map<std::string, std::pair<double, std::string>> open;  // monitor -> begin, state
  auto close = [&](const std::string& monitor, double until) {
    const auto at = open.find(monitor);
    if (at == open.end()) return;
    if (at->second.second != "armed")
      plot.spans.push_back({at->second.first, until, "", level_of(at->second.second)});
    open.erase(at);
  };
  for (const Event& e : run.events) {
    if (e.channel != name_of(channel)) continue;
    close(e.monitor, e.t_s);
    if (e.state == "alarm" || e.state == "warning" || e.state == "signal-fault")
      open[e.monitor] = {e.t_s, e.state};
    if (e.state == "alarm")
      plot.marks.push_back({e.t_s, e.monitor + ": " + e.reason, Level::alarm});
  }
  for (const std::string monitor : {"chatter", "collision"}) close(monitor, run.to_s);
  if (!explain || plot.marks.size() > kMostExplained)
    for (report::Mark& m : plot.marks) m.label.clear();
}

report::PlotGroup pictures(const MonitorRun& run, const DriveHistory& drive) {
  const bool spindle = drive.channel == Channel::spindle;
  report::PlotGroup group;
  report::Plot estimate;
  estimate.title = spindle ? "Cutting torque" : "Cutting force";
  estimate.caption =
      "Estimated from motor effort and motion; friction, inertia and gravity removed.";
  estimate.x_label = "time";
  estimate.x_unit = "s";
  estimate.y_label = spindle ? "torque" : "force";
  estimate.series.push_back(series_of(drive.estimate, "estimate", drive.unit));
  mark(run, drive.channel, true, estimate);
  group.plots.push_back(std::move(estimate));

  report::Plot watched;
  watched.title = spindle ? "Vibration power" : "Disturbance jerk";
  watched.x_label = "time";
  watched.x_unit = "s";
  watched.y_label = spindle ? "power" : "rate of force";
  watched.series.push_back(series_of(drive.value, spindle ? "chatter" : "jerk", value_unit(drive)));
  if (spindle) watched.series.push_back(series_of(drive.forced_power, "forced", value_unit(drive)));
  if (drive.threshold > 0)
    watched.limits.push_back({drive.threshold, "alarm threshold", Level::alarm});
  if (drive.threshold > 0 && !spindle)
    watched.limits.push_back({-drive.threshold, "", Level::alarm});
  mark(run, drive.channel, false, watched);
  group.plots.push_back(std::move(watched));

  report::Plot speed;
  speed.title = "Speed";
  speed.x_label = "time";
  speed.x_unit = "s";
  speed.y_label = "speed";
  speed.height_px = 120;
  speed.series.push_back(series_of(drive.speed, "speed", spindle ? "rpm" : "m/s"));
  group.plots.push_back(std::move(speed));
  return group;
}

report::Plot spectrum(const DriveHistory& drive) {
  const bool spindle = drive.channel == Channel::spindle;
  report::Plot plot;
  plot.title = spindle ? "Spectrum of the cutting torque" : "Spectrum of the cutting force";
  plot.caption =
      "Welch average over the record, Hann window; the lines of a sinusoid sum to its mean square.";
  plot.x_label = "frequency";
  plot.x_unit = "Hz";
  plot.y_label = "power per line";
  plot.log_y = true;
  report::Series s;
  s.name = "estimate";
  s.unit = drive.unit + "2";
  s.x = drive.spectrum.frequency_hz();
  s.y = drive.spectrum.power();
  s.x.erase(s.x.begin());
  s.y.erase(s.y.begin());
  plot.series.push_back(std::move(s));
  return plot;
}

report::Histogram histogram(const DriveHistory& drive) {
  const bool spindle = drive.channel == Channel::spindle;
  report::Histogram h;
  h.title = spindle ? "Chatter power" : "Disturbance jerk";
  h.caption = "How often each value was seen, and where the threshold lies.";
  h.x_label = spindle ? "chatter power" : "jerk";
  h.x_unit = value_unit(drive);
  h.values = drive.values;
  h.log_count = true;
  if (drive.threshold > 0) h.limits.push_back({drive.threshold, "alarm threshold", Level::alarm});
  if (drive.threshold > 0 && !spindle)
    h.limits.push_back({-drive.threshold, "alarm threshold", Level::alarm});
  return h;
}

}  // namespace

void Envelope::add(double t_s, double value) {
  if (!std::isfinite(value)) return;
  if (buckets_.empty() || buckets_.back().count == per_bucket_) {
    if (buckets_.size() == kMostBuckets) {
      for (std::size_t i = 0; i < kMostBuckets / 2; ++i) {
        const Bucket& a = buckets_[2 * i];
        const Bucket& b = buckets_[2 * i + 1];
        Bucket joined = a;
        if (b.low < a.low) {
          joined.low = b.low;
          joined.t_low = b.t_low;
        }
        if (b.high > a.high) {
          joined.high = b.high;
          joined.t_high = b.t_high;
        }
        joined.count = a.count + b.count;
        buckets_[i] = joined;
      }
      buckets_.resize(kMostBuckets / 2);
      per_bucket_ *= 2;
    }
    buckets_.push_back({t_s, value, t_s, value, 0});
  }
  Bucket& b = buckets_.back();
  if (value < b.low) {
    b.low = value;
    b.t_low = t_s;
  }
  if (value > b.high) {
    b.high = value;
    b.t_high = t_s;
  }
  ++b.count;
}

double Envelope::largest_magnitude() const {
  double largest = 0;
  for (const Bucket& b : buckets_) largest = std::max({largest, std::abs(b.low), std::abs(b.high)});
  return largest;
}

void Envelope::points(std::vector<double>& x, std::vector<double>& y) const {
  for (const Bucket& b : buckets_) {
    const bool low_first = b.t_low <= b.t_high;
    x.push_back(low_first ? b.t_low : b.t_high);
    y.push_back(low_first ? b.low : b.high);
    if (b.t_low == b.t_high) continue;
    x.push_back(low_first ? b.t_high : b.t_low);
    y.push_back(low_first ? b.high : b.low);
  }
}

Expected<Done> write_monitor_report(const MonitorRun& run, const std::string& path) {
  report::Report page("servosense monitor", run.trace + " on " + run.machine);
  const Level level = run.alarms > 0                ? Level::alarm
                      : run.verdict.word == "clear" ? Level::info
                                                    : Level::warning;
  page.add(report::Note{run.verdict.sentence, level});
  report::KeyFigures key;
  key.figures.push_back({"verdict", report::Cell(run.verdict.word), "", level});
  key.figures.push_back({"monitors that watched",
                         report::Cell(std::to_string(run.verdict.watched) + " of " +
                                      std::to_string(run.verdict.wanted)),
                         "", run.verdict.watched == 0 ? Level::warning : Level::none});
  key.figures.push_back({"alarms", report::Cell(static_cast<double>(run.alarms)), "",
                         run.alarms > 0 ? Level::alarm : Level::none});
  key.figures.push_back({"warnings", report::Cell(static_cast<double>(run.warnings)), "",
                         run.warnings > 0 ? Level::warning : Level::none});
  key.figures.push_back({"recorded", report::Cell(run.to_s - run.from_s, 3), "s"});
  key.figures.push_back({"sample rate", report::Cell(1 / run.sample_period_s, 4), "Hz"});
  for (const DriveHistory& drive : run.drives)
    key.figures.push_back({"largest on " + std::string(name_of(drive.channel)),
                           report::Cell(drive.estimate.largest_magnitude(), 3), drive.unit});
  page.add(std::move(key));
  for (const std::string& note : run.notes) page.add(report::Note{note, Level::info});
  for (const std::string& remark : run.plan.remarks) page.add(report::Note{remark, Level::info});
  if (run.missing > 0)
    page.add(report::Note{std::to_string(run.missing) +
                              " samples are missing from the trace; short "
                              "holes were bridged, monitors started anew after long ones.",
                          Level::warning});

  report::Table events{
      "",
      "",
      {"time [s]", "monitor", "channel", "state", "value", "threshold", "what it means"},
      {}};
  constexpr std::size_t kMostRows = 60;
  for (const Event& e : run.events) {
    if (e.state != "alarm" && e.state != "warning" && e.state != "signal-fault") continue;
    if (events.rows.size() == kMostRows) {
      events.caption =
          "The first " + std::to_string(kMostRows) + " are listed; the event file has all.";
      break;
    }
    events.rows.push_back({{report::Cell(e.t_s, 6), e.monitor, e.channel, e.state,
                            report::Cell(e.value, 3), report::Cell(e.threshold, 3), e.reason},
                           level_of(e.state)});
  }
  for (const DriveHistory& drive : run.drives) {
    page.add(report::Heading{drive_title(drive.channel)});
    page.add(pictures(run, drive));
    if (drive.spectrum.segments() > 0) page.add(spectrum(drive));
    if (!drive.values.empty()) page.add(histogram(drive));
  }

  if (!events.rows.empty()) {
    page.add(report::Heading{"Events"});
    page.add(std::move(events));
  }
  page.add(report::Heading{"What was watched"});
  report::Table monitors{"", "", {"monitor", "channel", "runs", "watched [s]", ""}, {}};
  for (std::size_t i = 0; i < run.plan.monitors.size(); ++i) {
    const MonitorAvailability& m = run.plan.monitors[i];
    monitors.rows.push_back(
        {{name_of(m.monitor), std::string(name_of(m.channel)), m.runs ? "yes" : "no",
          report::Cell(run.watched[i].armed_s, 3), m.reason},
         Level::none});
  }
  page.add(std::move(monitors));
  page.add(report::Paragraph{"A monitoring aid, not a safety function."});
  return page.write(path);
}

}  // namespace servosense::cli
