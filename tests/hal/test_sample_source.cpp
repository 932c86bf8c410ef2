// Trace source: which columns feed a drive, and what becomes of holes, jitter, empty and invalid
// fields, several rates and counters that wrap.
#include <algorithm>
#include <cmath>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/hal/sample_source.hpp"

namespace {

using namespace servosense;

Expected<SampleSource> source_of(const std::string& text, unsigned max_fill = 8) {
  auto reader = TraceReader::from_stream(std::make_unique<std::istringstream>(text), "t.csv");
  CHECK(reader.has_value());
  if (!reader) return reader.error();
  return SampleSource::open(std::move(*reader), "t.csv", max_fill);
}

struct Played {
  std::vector<ServoSample<double>> samples;
  std::vector<bool> recorded;
  SourceHealth health;
  double period_s = 0;
  std::string error;
};

Played play(const std::string& text, unsigned max_fill = 8) {
  Played played;
  auto source = source_of(text, max_fill);
  if (!source) {
    played.error = source.error().sentence;
    return played;
  }
  played.period_s = source->sample_period_s();
  ServoSample<double> sample;
  for (;;) {
    const auto more = source->next(sample);
    if (!more) played.error = more.error().sentence;
    if (!more || !*more) break;
    played.samples.push_back(sample);
    played.recorded.push_back(source->recorded());
  }
  played.health = source->health();
  return played;
}

/// A trace at 1 kHz with x.position_m = 0.001 n and x.force_N = n, the rows in `leave_out` missing.
std::string with_holes(int rows, const std::vector<std::pair<int, int>>& leave_out) {
  std::ostringstream out;
  out << "t_s,x.position_m,x.force_N\n";
  for (int n = 0; n < rows; ++n) {
    bool out_of_it = false;
    for (const auto& [from, to] : leave_out) out_of_it = out_of_it || (n >= from && n < to);
    if (!out_of_it) out << n * 0.001 << ',' << n * 0.001 << ',' << n << '\n';
  }
  return out.str();
}

void plain() {
  const Played p = play(with_holes(50, {}));
  CHECK_TEXT(p.error, "");
  CHECK(p.samples.size() == 50);
  CHECK_NEAR(p.period_s, 1e-3, 1e-12);
  CHECK(p.health.rows == 50 && p.health.gaps == 0 && p.health.missing_samples == 0);
  CHECK_NEAR(p.health.worst_jitter_s, 0.0, 1e-12);
  for (std::size_t i = 0; i < p.samples.size(); ++i) {
    const RawDriveSample<double>& x = p.samples[i].axis[0];
    CHECK(p.samples[i].t_ns == static_cast<Nanoseconds>(i) * 1'000'000);
    CHECK(p.recorded[i]);
    CHECK_NEAR(x.motion, 0.001 * static_cast<double>(i), 1e-12);
    CHECK(x.effort == static_cast<double>(i));
    CHECK(x.motion_quality == Quality::good && x.effort_quality == Quality::good);
  }
}

// More rows than are looked at for the rate: none is lost or repeated.
void longer_than_the_look_ahead() {
  const Played p = play(with_holes(1500, {}));
  CHECK(p.samples.size() == 1500);
  for (std::size_t i = 0; i < p.samples.size(); ++i)
    CHECK(p.samples[i].axis[0].effort == static_cast<double>(i));
}

void short_hole() {
  const Played p = play(with_holes(30, {{10, 13}}));
  CHECK(p.samples.size() == 30);  // three stand-ins
  CHECK(p.health.rows == 27 && p.health.gaps == 1 && p.health.missing_samples == 3);
  for (std::size_t i = 0; i < p.samples.size(); ++i) {
    const bool missing = i >= 10 && i < 13;
    CHECK(p.recorded[i] == !missing);
    CHECK(p.samples[i].t_ns == static_cast<Nanoseconds>(i) * 1'000'000);
    const Quality expected = missing ? Quality::missing : Quality::good;
    CHECK(p.samples[i].axis[0].motion_quality == expected);
    CHECK(p.samples[i].axis[0].effort_quality == expected);
  }
}

// A long hole gives one stand-in more than a drive bridges, so that it restarts; time then jumps.
void long_hole() {
  const Played p = play(with_holes(2000, {{100, 1600}}));
  CHECK(p.samples.size() == 500 + 9);
  CHECK(p.health.gaps == 1 && p.health.missing_samples == 1500);
  if (p.samples.size() != 509) return;
  CHECK(!p.recorded[108] && p.recorded[109]);
  CHECK(p.samples[108].t_ns == 108'000'000);
  CHECK(p.samples[109].t_ns == 1'600'000'000);

  DriveInput<double> input;
  DriveInputConfig c;
  c.kind = MotionKind::position;
  c.sample_period_s = p.period_s;
  input.configure(c);
  for (std::size_t i = 0; i < p.samples.size(); ++i) {
    const DriveSample<double> s = input.process(p.samples[i].axis[0]);
    CHECK(has(s.quality, Quality::gap) == (i == 108));
    CHECK(has(s.quality, Quality::restarted) == (i == 0 || i == 109));
    if (i >= 110) CHECK_NEAR(s.increment, 1e-3, 1e-12);
  }
}

void holes_in_a_row() {
  const Played p = play(with_holes(40, {{10, 12}, {13, 14}, {20, 33}}), 4);
  CHECK(p.health.gaps == 3 && p.health.missing_samples == 2 + 1 + 13);
  CHECK(p.samples.size() == 40 - 13 + 5);
  for (std::size_t i = 1; i < p.samples.size(); ++i)
    CHECK(p.samples[i].t_ns > p.samples[i - 1].t_ns);
}

// Instants that wander by less than half a period are no holes, and do not add up.
void jitter() {
  std::ostringstream text;
  text << "t_s,x.position_m,x.force_N\n";
  text.precision(12);
  for (int n = 0; n < 600; ++n)
    text << n * 0.001 + (n % 2 == 0 ? 0.0 : 0.0002) << ',' << 1e-6 * n << ",1\n";
  const Played p = play(text.str());
  CHECK(p.samples.size() == 600);
  CHECK(p.health.gaps == 0);
  // Rows are off the clock between them by 0.1 ms, and by what the loop follows of that.
  CHECK_NEAR(p.health.worst_jitter_s, 0.0001, 0.0001 / 64);
  CHECK_NEAR(p.period_s, 0.001, 1e-9);
  CHECK(p.samples[1].t_ns == 1'200'000);

  // A clock that runs 100 ppm off its name never opens a hole.
  std::ostringstream drifting;
  drifting << "t_s,x.position_m,x.force_N\n";
  drifting.precision(12);
  for (int n = 0; n < 20000; ++n) drifting << n * 0.0010001 << ',' << 1e-6 * n << ",1\n";
  const Played q = play(drifting.str());
  CHECK(q.samples.size() == 20000 && q.health.gaps == 0);
}

// `nan` is a value that is no good; an empty field is no new value.
void invalid_and_empty() {
  const Played p = play(
      "t_s,x.position_m,x.current_A\n"
      "0,0.1,1\n0.001,nan,2\n0.002,0.3,nan\n0.003,,3\n0.004,0.5,\n0.005,0.6,4\n");
  CHECK(p.samples.size() == 6);
  if (p.samples.size() != 6) return;
  const auto motion = [&](std::size_t i) { return p.samples[i].axis[0].motion_quality; };
  const auto effort = [&](std::size_t i) { return p.samples[i].axis[0].effort_quality; };
  CHECK(motion(1) == Quality::invalid && effort(1) == Quality::good);
  CHECK(motion(2) == Quality::good && effort(2) == Quality::invalid);
  CHECK(motion(3) == Quality::held && effort(3) == Quality::good);
  CHECK(motion(4) == Quality::good && effort(4) == Quality::held);
  CHECK(motion(5) == Quality::good && effort(5) == Quality::good);
  CHECK(p.samples[5].axis[0].effort == 4);
}

// Current at a quarter of the encoder's rate (Koike 2016, section 3.1): held, and no fault.
void several_rates() {
  std::ostringstream text;
  text << "t_s,spindle.angle_counts,spindle.current_A\n";
  text.precision(12);
  for (int n = 0; n < 800; ++n) {
    text << n * 125e-6 << ',' << 100 * n << ',';
    if (n % 4 == 0) text << 0.5 * n;
    text << '\n';
  }
  const Played p = play(text.str());
  CHECK_NEAR(p.period_s, 125e-6, 1e-12);
  CHECK(p.samples.size() == 800 && p.health.gaps == 0);
  DriveInputConfig c;
  c.unit_per_count = 1e-4;
  c.sample_period_s = p.period_s;
  DriveInput<double> input;
  input.configure(c);
  for (std::size_t i = 0; i < p.samples.size(); ++i) {
    const DriveSample<double> s = input.process(p.samples[i].spindle);
    CHECK(s.effort == 0.5 * static_cast<double>(i - i % 4));
    CHECK(!has(s.quality, kUnusable | Quality::gap));
    if (i > 0) CHECK_NEAR(s.increment, 0.01, 1e-12);
  }
}

// Counts are exact, and a 16-bit counter that wraps goes on counting.
void wrapping_counts() {
  std::ostringstream text;
  text << "t_s,x.angle_counts,x.current_A\n";
  text.precision(12);
  for (int n = 0; n < 400; ++n)
    text << n * 0.001 << ',' << ((n * 1000 + 32768) % 65536) - 32768 << ",0\n";
  const Played p = play(text.str());
  DriveInputConfig c;
  c.sample_period_s = 1e-3;
  c.unit_per_count = 1e-6;
  c.unit_per_turn = 0.01;
  c.counter_bits = 16;
  DriveInput<double> input;
  input.configure(c);
  double position = 0;
  for (const auto& sample : p.samples) {
    const DriveSample<double> s = input.process(sample.axis[0]);
    position = s.position;
  }
  CHECK_NEAR(position, 399 * 1000 * 1e-6, 1e-12);

  const Played exact = play("t_s,x.angle_counts,x.current_A\n0,9007199254740993,0\n0.001,-3,0\n");
  CHECK(exact.samples.size() == 2);
  if (exact.samples.size() == 2) {
    CHECK(exact.samples[0].axis[0].counts == 9007199254740993);  // no double holds it
    CHECK(exact.samples[1].axis[0].counts == -3);
  }
}

// Counts before angle before position before speed, current before torque before force; in any
// column order.
void column_preference() {
  using Q = Quantity;
  const auto columns = [](Channel channel, std::vector<Signal> signals) {
    return drive_columns(signals, channel);
  };
  const Channel s = Channel::spindle, x = Channel::x;
  auto c = columns(s, {{s, Q::speed_rad_s},
                       {s, Q::torque_Nm},
                       {s, Q::angle_rad},
                       {s, Q::current_A},
                       {s, Q::angle_counts}});
  CHECK(c && c->signal.motion == MotionKind::counts && c->motion_column == 4);
  CHECK(c && c->signal.effort == EffortKind::current_A && c->effort_column == 3);
  c = columns(s, {{s, Q::speed_rad_s}, {s, Q::torque_Nm}, {s, Q::angle_rad}});
  CHECK(c && c->signal.motion == MotionKind::position && c->motion_column == 2);
  CHECK(c && c->signal.effort == EffortKind::torque_Nm && c->effort_column == 1);
  c = columns(s, {{s, Q::torque_Nm}, {s, Q::speed_rad_s}});
  CHECK(c && c->signal.motion == MotionKind::velocity && c->motion_column == 1);
  c = columns(x, {{x, Q::velocity_m_s}, {x, Q::force_N}, {x, Q::position_m}, {x, Q::torque_Nm}});
  CHECK(c && c->signal.motion == MotionKind::position && c->motion_column == 2);
  CHECK(c && c->signal.effort == EffortKind::torque_Nm && c->effort_column == 3);
  c = columns(x, {{x, Q::velocity_m_s}, {x, Q::force_N}});
  CHECK(c && c->signal.motion == MotionKind::velocity && c->signal.effort == EffortKind::force_N);

  // A machine file may name another column, and a speed that no column tells.
  const Signal other{Channel::tool, Q::acceleration_x_m_s2};
  c = drive_columns({{s, Q::angle_counts}, {s, Q::current_A}, other}, s,
                    {"tool.acceleration_x_m_s2", 0});
  CHECK(c && c->effort_column == 2 && c->signal.effort == EffortKind::torque_Nm);
  c = drive_columns({{x, Q::position_m}, {x, Q::force_N}, {x, Q::current_A}}, x, {"x.force_N", 0});
  CHECK(c && c->effort_column == 1 && c->signal.effort == EffortKind::force_N);
  c = drive_columns({other}, s, {"tool.acceleration_x_m_s2", 600});
  CHECK(c && c->signal.motion == MotionKind::velocity && c->constant_motion == 600);
  c = drive_columns({{s, Q::speed_rad_s}, {s, Q::torque_Nm}}, s, {"", 600});
  CHECK(c && c->constant_motion == 0);
  CHECK(!drive_columns({{s, Q::speed_rad_s}}, s, {"tool.acceleration_x_m_s2", 0}));

  // The motor of an axis moves it by its lead, where that is known.
  ColumnChoice lead;
  lead.lead_m = 0.01;
  c = drive_columns({{x, Q::position_m}, {x, Q::angle_rad}, {x, Q::force_N}}, x, lead);
  CHECK(c && c->motion_column == 1 && c->signal.motion == MotionKind::position);
  CHECK(c && std::abs(c->motion_scale - 0.01 / kTwoPi) < 1e-15);
  c = drive_columns({{x, Q::speed_rad_s}, {x, Q::force_N}}, x, lead);
  CHECK(c && c->motion_column == 0 && c->signal.motion == MotionKind::velocity);

  // A spindle has no force, an axis without a lead no angle; commands are not motion; other
  // channels do not count.
  CHECK(!columns(s, {{s, Q::angle_counts}, {s, Q::force_N}}));
  CHECK(!columns(x, {{x, Q::angle_rad}, {x, Q::force_N}}));
  CHECK(!columns(x, {{x, Q::command_position_m}, {x, Q::current_A}}));
  CHECK(!columns(x, {{x, Q::position_m}, {Channel::y, Q::current_A}}));
  CHECK(!columns(x, {{x, Q::position_m}}));
  CHECK(!columns(x, {}));
}

void several_drives() {
  const Played p = play(
      "t_s,z.force_N,spindle.speed_rad_s,x.position_m,z.position_m,spindle.torque_Nm\n"
      "0,1,2,3,4,5\n0.001,6,7,8,9,10\n");
  CHECK(p.samples.size() == 2);
  if (p.samples.size() != 2) return;
  CHECK(p.samples[1].spindle.motion == 7 && p.samples[1].spindle.effort == 10);
  CHECK(p.samples[1].axis[2].motion == 9 && p.samples[1].axis[2].effort == 6);
  auto source = source_of("t_s,x.position_m,z.position_m,z.force_N\n0,1,2,3\n0.001,4,5,6\n");
  CHECK(source && !source->spindle() && !source->axis(0) && !source->axis(1) && source->axis(2));
}

void errors() {
  CHECK(play("t_s,x.position_m\n0,1\n1,2\n").error.find("t.csv: no drive has both motion and") ==
        0);
  CHECK(play("t_s,x.position_m,x.force_N\n").error.find("only 0 row") != std::string::npos);
  CHECK(play("t_s,x.position_m,x.force_N\n0,1,2\n").error.find("only 1 row") != std::string::npos);
  // A bad line among the first rows and one far behind them: the same sentence, no sample after it.
  const Played early = play("t_s,x.position_m,x.force_N\n0,1,2\n0.001,oops,2\n");
  CHECK(early.samples.empty() && early.error.find("t.csv:3") != std::string::npos);
  const Played late = play(with_holes(1000, {}) + "1,oops,2\n");
  CHECK(late.samples.size() == 1000 && late.error.find("t.csv:1002") != std::string::npos);
  CHECK(late.error.find("oops") != std::string::npos);
}

// A bus that falls silent for some periods, told of it while it lasts, gives the same samples as
// its recording: that is what makes a live run and its replay agree.
class ListedRows final : public RowSource {
 public:
  explicit ListedRows(std::vector<TraceRow> rows) : rows_(std::move(rows)) {}
  [[nodiscard]] const std::vector<Signal>& signals() const override { return signals_; }
  [[nodiscard]] double period_s() const override { return 0.001; }
  Expected<bool> next(TraceRow& row) override {
    if (at_ == rows_.size()) return false;
    row = rows_[at_++];
    return true;
  }

 private:
  std::vector<Signal> signals_ = {{Channel::x, Quantity::position_m},
                                  {Channel::x, Quantity::force_N}};
  std::vector<TraceRow> rows_;
  std::size_t at_ = 0;
};

void a_silent_bus_is_a_hole() {
  constexpr Nanoseconds kPeriod = 1'000'000;
  for (const int silent : {1, 2, 7, 8, 9, 10, 500}) {
    std::vector<TraceRow> recorded, live;
    for (int n = 0; n < 40 + silent; ++n) {
      const bool there = n < 20 || n >= 20 + silent;
      TraceRow row;
      row.t_ns = n * kPeriod;
      if (there) {
        row.fields = {TraceField::of(n), TraceField::of(2 * n)};
        recorded.push_back(row);
        live.push_back(row);
      } else if (n % 3 != 0) {  // the waits end when they end
        row.t_ns += kPeriod / 3;
        live.push_back(row);
      }
    }
    auto play_rows = [](std::vector<TraceRow> rows) {
      std::vector<std::pair<Nanoseconds, Quality>> samples;
      auto source = SampleSource::open(std::make_unique<ListedRows>(std::move(rows)), "bus");
      ServoSample<double> sample;
      while (source && *source->next(sample))
        samples.emplace_back(sample.t_ns, sample.axis[0].motion_quality);
      return samples;
    };
    const auto a = play_rows(recorded), b = play_rows(live);
    CHECK(a == b);
    CHECK(a.size() == 40U + static_cast<unsigned>(std::min(silent, 9)));
    const bool dead = std::any_of(a.begin(), a.end(),
                                  [](const auto& s) { return has(s.second, Quality::dead_bus); });
    CHECK(dead == (silent > 8));
  }
}

}  // namespace

int main() {
  plain();
  longer_than_the_look_ahead();
  short_hole();
  long_hole();
  holes_in_a_row();
  jitter();
  invalid_and_empty();
  several_rates();
  wrapping_counts();
  column_preference();
  several_drives();
  errors();
  a_silent_bus_is_a_hole();
  return check::done();
}
