// The faults of the matrix: what each does to the rows of a record, and when it must be named.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "faults/base_record.hpp"

namespace faults {

/// Where a fault is put.
struct Place {
  State state = State::standing;
  Reporting reporting;
  double speed = 0;  ///< of x, where it moves steadily [m/s]
  Channel channel = Channel::machine;
  std::size_t from = 0;  ///< first row at fault

  [[nodiscard]] std::size_t rows(double seconds) const {
    return std::max<std::size_t>(
        1, static_cast<std::size_t>(std::lround(seconds * reporting.rate_hz())));
  }
  [[nodiscard]] std::size_t motion() const {
    return channel == Channel::spindle ? spindle_counts : x_counts;
  }
  [[nodiscard]] std::size_t effort() const {
    return channel == Channel::spindle ? spindle_current : x_current;
  }
  [[nodiscard]] double limit_A() const {
    return channel == Channel::spindle ? kSpindleLimit_A : kAxisLimit_A;
  }
  [[nodiscard]] bool moves() const { return state != State::standing; }
};

using Random = std::mt19937;

/// Longer than any record.
inline constexpr double kToTheEnd = 1e6;

struct Spoil {
  std::function<void(Rows&, const Place&, Random&)> apply;
  double lasts_s = 0;  ///< 0: a row, or a few
};

/// When it must be named, counted from the first row at fault.
struct Named {
  enum class By { nothing, samples, seconds } by = By::nothing;
  double limit = 0;
  bool in_motion = false;  ///< only where the drive moves

  /// In samples; nothing: it may go unseen.
  [[nodiscard]] std::optional<double> at(const Place& p) const {
    if (by == By::nothing || (in_motion && p.state == State::standing)) return std::nullopt;
    return by == By::samples ? limit : limit * p.reporting.rate_hz();
  }
  [[nodiscard]] std::string text() const {
    char text[40];
    if (by == By::nothing) return "not always";
    if (by == By::samples && limit == 1) return "the sample";
    std::snprintf(text, sizeof text, by == By::samples ? "%g samples" : "%g s", limit);
    return std::string(text) + (in_motion ? " in motion" : "");
  }
};
[[nodiscard]] inline Named within(double samples) { return {Named::By::samples, samples}; }
[[nodiscard]] inline Named within_s(double seconds) { return {Named::By::seconds, seconds}; }
[[nodiscard]] inline Named in_motion(Named n) {
  n.in_motion = true;
  return n;
}
[[nodiscard]] inline Named unseen() { return {}; }

enum class Part { nothing, rows, time, motion, effort };
[[nodiscard]] constexpr const char* name_of(Part p) {
  constexpr const char* kNames[] = {"nothing", "rows", "time", "motion", "effort"};
  return kNames[static_cast<int>(p)];
}

struct Fault {
  Part part = Part::rows;
  std::string kind, size;
  Spoil spoil;
  Named named;
  bool blinds = false;  ///< its channel may miss what comes while it is there
  bool speeds = false;  ///< looked at at every speed of x
  bool from_the_start = false;

  [[nodiscard]] bool to_the_end() const { return spoil.lasts_s >= kToTheEnd; }
};

// --- what it does ---
using Each = std::function<void(Rows&, std::size_t, const Place&, Random&)>;

/// To `n` rows from the first on.
inline Spoil first(std::size_t n, Each each) {
  return {[=](Rows& rows, const Place& p, Random& random) {
    for (std::size_t i = p.from; i < std::min(p.from + n, rows.size()); ++i)
      each(rows, i, p, random);
  }};
}
inline std::size_t end_of(const Rows& rows, const Place& p, double seconds) {
  return std::min(p.from + p.rows(seconds), rows.size());
}
inline Spoil during(double seconds, Each each) {
  const auto apply = [=](Rows& rows, const Place& p, Random& random) {
    for (std::size_t i = p.from; i < end_of(rows, p, seconds); ++i) each(rows, i, p, random);
  };
  return {apply, seconds};
}
/// The first ones, up to a current update, then by chance one in `n`.
inline Each one_in(unsigned n, Each each) {
  return [=](Rows& rows, std::size_t i, const Place& p, Random& random) {
    const auto every = static_cast<std::size_t>(p.reporting.current_every);
    if (i < p.from + every || random() % n == 0) each(rows, i, p, random);
  };
}
using Value = std::function<TraceField(TraceField, const Place&)>;
inline Each motion_is(Value value) {
  return [=](Rows& rows, std::size_t i, const Place& p, Random&) {
    TraceField& f = rows[i].fields[p.motion()];
    f = value(f, p);
  };
}
/// Of a current that arrives.
inline Each effort_is(Value value) {
  return [=](Rows& rows, std::size_t i, const Place& p, Random&) {
    TraceField& f = rows[i].fields[p.effort()];
    if (f.state != TraceField::State::empty) f = value(f, p);
  };
}
inline TraceField wrapped(std::int64_t counts) {
  return TraceField::of_counts(counts & 0xffffffff);
}
inline Each counts_off(std::int64_t by) {
  return motion_is([=](TraceField f, const Place&) { return wrapped(f.counts + by); });
}
/// The first update of the current and, where rows repeat it, the rows that do.
inline Spoil one_update(Value value) {
  return {[=](Rows& rows, const Place& p, Random& random) {
    const auto every = static_cast<std::size_t>(p.reporting.current_every);
    const std::size_t at = (p.from + every - 1) / every * every;
    for (std::size_t i = at; i < std::min(at + every, rows.size()); ++i)
      effort_is(value)(rows, i, p, random);
  }};
}

// --- rows and time ---
inline Spoil lost(double seconds, std::function<bool(std::size_t, Random&)> is_lost) {
  const auto apply = [=](Rows& rows, const Place& p, Random& random) {
    const std::size_t end = end_of(rows, p, seconds);
    std::size_t to = p.from;
    for (std::size_t i = p.from; i < rows.size(); ++i)
      if (i >= end || !is_lost(i - p.from, random)) rows[to++] = rows[i];
    rows.resize(to);
  };
  return {apply, seconds};
}
inline Spoil lose(std::size_t n) {
  return {lost(1, [=](std::size_t i, Random&) { return i < n; }).apply};
}
inline Spoil lose_for(double seconds) {
  return lost(seconds, [](std::size_t, Random&) { return true; });
}
inline Spoil lose_every(std::size_t n, double seconds) {
  return lost(seconds, [=](std::size_t i, Random&) { return i % n == 0; });
}
/// The first row, then by chance one in `n`, each with those behind it up to `burst`.
inline Spoil lose_one_in(unsigned n, double seconds, std::size_t burst = 1) {
  return lost(seconds, [=, left = std::size_t{0}](std::size_t i, Random& random) mutable {
    if (i == 0 || (left == 0 && random() % n == 0)) left = burst;
    return left > 0 && left-- > 0;
  });
}
/// More rows than there were: `more(row, next)` behind each that `is_doubled` picks.
inline Spoil added(double seconds, unsigned one_of,
                   std::function<Row(const Row&, const Row&, const Place&)> more) {
  const auto apply = [=](Rows& rows, const Place& p, Random& random) {
    const std::size_t end = std::min(end_of(rows, p, seconds), rows.size() - 1);
    Rows all(rows.begin(), rows.begin() + static_cast<std::ptrdiff_t>(p.from));
    for (std::size_t i = p.from; i < rows.size(); ++i) {
      all.push_back(rows[i]);
      if (i < end && (i == p.from || random() % one_of == 0))
        all.push_back(more(rows[i], rows[i + 1], p));
    }
    rows = std::move(all);
  };
  return {apply, seconds};
}
inline Row again(const Row& row, const Row&, const Place&) {
  Row copy = row;
  ++copy.t_ns;
  return copy;
}
inline Row middle(const Row& row, const Row& next, const Place& p) {
  Row between = row;
  between.t_ns += p.reporting.period_ns() / 2;
  for (const std::size_t c : {spindle_counts, x_counts}) {
    const auto way = static_cast<std::int32_t>(next.fields[c].counts - row.fields[c].counts);
    between.fields[c] = wrapped(row.fields[c].counts + way / 2);
  }
  return between;
}
/// What two neighbours say is exchanged, not their stamps.
inline void swap_values(Rows& rows, std::size_t i, const Place&, Random&) {
  if (i + 1 < rows.size()) std::swap(rows[i].fields, rows[i + 1].fields);
}
/// Two neighbours come in the wrong order, stamps and all.
inline void swap_rows(Rows& rows, std::size_t i, const Place&, Random&) {
  if (i + 1 < rows.size()) std::swap(rows[i], rows[i + 1]);
}
inline Spoil step(Nanoseconds by) {
  return {[=](Rows& rows, const Place& p, Random&) {
    for (std::size_t i = p.from; i < rows.size(); ++i) rows[i].t_ns += by;
  }};
}
/// Uniform.
inline Spoil jitter(double us) {
  return during(0.4, [=](Rows& rows, std::size_t i, const Place&, Random& random) {
    rows[i].t_ns +=
        std::llround(1000 * us * (2.0 * (static_cast<double>(random()) / 4294967296.0) - 1));
  });
}
/// Stamps run `rate` times too slowly for 0.4 s.
inline Spoil dense(double rate) {
  const auto apply = [=](Rows& rows, const Place& p, Random&) {
    const std::size_t end = end_of(rows, p, 0.4);
    const Nanoseconds start = rows[p.from - 1].t_ns;
    Nanoseconds saved = 0;
    for (std::size_t i = p.from; i < rows.size(); ++i) {
      if (i < end) saved = std::llround(static_cast<double>(rows[i].t_ns - start) * (1 - 1 / rate));
      rows[i].t_ns -= saved;
    }
  };
  return {apply, 0.4};
}

// --- motion ---
inline Spoil stuck(double seconds) {
  const auto apply = [=](Rows& rows, const Place& p, Random& random) {
    const TraceField last = rows[p.from - 1].fields[p.motion()];
    during(seconds, motion_is([=](TraceField, const Place&) { return last; }))
        .apply(rows, p, random);
  };
  return {apply, seconds};
}
inline Spoil narrow(unsigned bits, double seconds) {
  return during(seconds, motion_is([=](TraceField f, const Place&) {
                  return TraceField::of_counts(f.counts & ((std::int64_t{1} << bits) - 1));
                }));
}
inline Spoil bit_stuck(unsigned bit, bool high) {
  return during(0.4, motion_is([=](TraceField f, const Place&) {
                  const std::int64_t mask = std::int64_t{1} << bit;
                  return TraceField::of_counts(high ? f.counts | mask : f.counts & ~mask);
                }));
}

// --- effort ---
inline TraceField nothing(TraceField, const Place&) { return TraceField::none(); }
inline TraceField no_good(TraceField, const Place&) { return TraceField::invalid(); }
inline TraceField zero(TraceField, const Place&) { return TraceField::of(0); }
inline TraceField flipped(TraceField f, const Place&) { return TraceField::of(-f.value); }
inline TraceField at_limit(TraceField, const Place& p) { return TraceField::of(p.limit_A()); }
inline Value amperes(double a) {
  return [=](TraceField, const Place&) { return TraceField::of(a); };
}
inline Spoil frozen(double seconds) {
  const auto apply = [=](Rows& rows, const Place& p, Random& random) {
    std::size_t at = p.from - 1;
    while (rows[at].fields[p.effort()].state == TraceField::State::empty) --at;
    const TraceField last = rows[at].fields[p.effort()];
    during(seconds, effort_is([=](TraceField, const Place&) { return last; }))
        .apply(rows, p, random);
  };
  return {apply, seconds};
}
inline Spoil silent(double seconds) { return during(seconds, effort_is(nothing)); }
inline Spoil never_arrived() {
  const auto apply = [](Rows& rows, const Place& p, Random&) {
    for (Row& row : rows) row.fields[p.effort()] = TraceField::none();
  };
  return {apply, kToTheEnd};
}
/// One update in `n` is `value`, from the first on.
inline Spoil bad_updates(unsigned n, const Value& value) {
  const auto apply = [=](Rows& rows, const Place& p, Random& random) {
    Place at = p;
    for (at.from = p.from; at.from < rows.size(); ++at.from)
      if (at.from == p.from || random() % n == 0) one_update(value).apply(rows, at, random);
  };
  return {apply, kToTheEnd};
}

/// All of them.
[[nodiscard]] inline std::vector<Fault> all_faults() {
  constexpr Nanoseconds kMs = 1'000'000, kSecond = 1'000 * kMs;
  std::vector<Fault> all;
  Part part = Part::nothing;
  const auto add = [&](const char* kind, const std::string& size, Spoil spoil,
                       Named named) -> Fault& {
    return all.emplace_back(Fault{part, kind, size, std::move(spoil), named});
  };
  const auto number = [](auto n) {
    char text[32];
    std::snprintf(text, sizeof text, "%g", static_cast<double>(n));
    return std::string(text);
  };
  add("nothing", "", {[](Rows&, const Place&, Random&) {}}, unseen()).speeds = true;

  part = Part::rows;
  for (const unsigned n : {1U, 2U, 3U, 8U, 9U, 20U}) add("lost", number(n), lose(n), within(1));
  add("lost", "0.1 s", lose_for(0.1), within(1));
  add("lost", "0.4 s", lose_for(0.4), within(1));
  add("lost", "every second for 0.4 s", lose_every(2, 0.4), within(1));
  add("lost", "every fourth for 0.4 s", lose_every(4, 0.4), within(1));
  add("lost", "1 in 100 for 0.4 s", lose_one_in(100, 0.4), within(1));
  add("lost", "bursts of 3 for 0.4 s", lose_one_in(50, 0.4, 3), within(1));
  add("lost", "bursts of 12 for 0.4 s", lose_one_in(100, 0.4, 12), within(1));
  add("lost", "1 in 1000 to the end", lose_one_in(1000, kToTheEnd), within(1));
  add("twice", "once", {added(1e-6, 1, again).apply}, within(2));
  add("twice", "1 in 10 for 0.4 s", added(0.4, 10, again), within(2));
  add("twice", "each for 0.4 s", added(0.4, 1, again), within(2));
  add("twice", "1 in 1000 to the end", added(kToTheEnd, 1000, again), within(2));
  add("in the wrong order", "once", first(1, swap_rows), within(3));
  add("in the wrong order", "1 in 10 for 0.4 s", during(0.4, one_in(10, swap_rows)), within(3));
  add("values exchanged", "once", first(1, swap_values), unseen());
  add("values exchanged", "1 in 10 for 0.4 s", during(0.4, one_in(10, swap_values)), unseen());

  part = Part::time;
  for (const double us : {5, 10, 20, 40, 60, 100, 200})
    add("jitter", number(us) + " us", jitter(us), unseen());
  add("clock ahead", "1 ms", step(kMs), unseen());
  add("clock ahead", "20 ms", step(20 * kMs), within(8));
  add("clock ahead", "1 s", step(kSecond), within(8));
  add("clock ahead", "1 h", step(3600 * kSecond), within(8));
  add("clock back", "1 ms", step(-kMs), within(8));
  add("clock back", "20 ms", step(-20 * kMs), within(8));
  add("clock back", "0.4 s", step(-400 * kMs), within(8));
  add("stamps too dense", "1.1 times", dense(1.1), within(8));
  add("stamps too dense", "2 times", dense(2), within(8));
  add("stamps too dense", "1000 times", dense(1000), within(8));
  add("stamps stand still", "0.4 s", dense(1e12), within(8));
  add("stamps too far apart", "2 times", dense(0.5), within(8));
  add("rate", "doubled for 0.4 s", added(0.4, 1, middle), within(8));

  part = Part::motion;
  for (const unsigned n : {1U, 3U, 9U})
    add("invalid", number(n), first(n, motion_is(no_good)), within(1));
  add("invalid", "0.1 s", during(0.1, motion_is(no_good)), within(1));
  add("invalid", "1 in 10 for 0.4 s", during(0.4, one_in(10, motion_is(no_good))), within(1));
  add("invalid", "1 in 1000 to the end", during(kToTheEnd, one_in(1000, motion_is(no_good))),
      within(1));
  const auto far = motion_is(
      [](TraceField, const Place&) { return TraceField::of_counts(1'000'000'000'000'007); });
  for (const unsigned n : {1U, 3U}) add("1e15 counts", number(n), first(n, far), within(1));
  for (const double s : {0.002, 0.02, 0.1, 0.4})
    add("stuck", number(1000 * s) + " ms", stuck(s), in_motion(within(8))).speeds = true;
  {
    Fault& f = add("stuck", "for good", stuck(kToTheEnd), in_motion(within(8)));
    f.speeds = f.blinds = true;
  }
  for (const std::int64_t counts : {10, 20, 50, 1000, 100'000}) {
    const std::string size = number(counts) + " counts";
    add("glitch out and back", size, first(1, counts_off(counts)), unseen());
    add("glitch of 3 samples", size, first(3, counts_off(-counts)), unseen());
    add("jump that stays", size, {during(kToTheEnd, counts_off(counts)).apply}, unseen());
  }
  add("glitch out and back", "20 counts, 1 in 1000 to the end",
      during(kToTheEnd, one_in(1000, counts_off(20))), unseen());
  for (const unsigned bits : {12U, 16U, 24U})
    add("counter narrower", number(bits) + " bits for 0.4 s", narrow(bits, 0.4), unseen());
  for (const unsigned bit : {1U, 4U, 6U, 9U, 12U})
    add("bit stuck", "bit " + number(bit) + " for 0.4 s", bit_stuck(bit, bit % 2 == 0), unseen());

  part = Part::effort;
  // Between updates nothing arrives that could be bad.
  add("invalid", "one update", one_update(no_good), within(8));
  add("invalid", "10 ms", during(0.01, effort_is(no_good)), within(8));
  add("invalid", "0.1 s", during(0.1, effort_is(no_good)), within(8));
  add("invalid", "1 in 10 for 0.4 s", during(0.4, one_in(10, effort_is(no_good))), within(8));
  add("invalid", "1 in 1000 to the end", during(kToTheEnd, one_in(1000, effort_is(no_good))),
      within(8));
  add("beyond any drive", "1e6 A, one update", one_update(amperes(1e6)), within(8));
  add("beyond any drive", "1e15 A, one update", one_update(amperes(1e15)), within(8));
  add("beyond any drive", "-1e15 A, 10 ms", during(0.01, effort_is(amperes(-1e15))), within(8));
  add("silent", "10 ms", silent(0.01), unseen());
  add("silent", "0.1 s", silent(0.1), within_s(0.05));
  add("silent", "0.4 s", silent(0.4), within_s(0.05));
  add("silent", "for good", silent(kToTheEnd), within_s(0.05)).blinds = true;
  {
    Fault& f = add("silent", "never arrived", never_arrived(), within_s(0.05));
    f.blinds = f.from_the_start = true;
  }
  const auto nine_in_ten = [](Rows& rows, std::size_t i, const Place& p, Random& random) {
    TraceField& f = rows[i].fields[p.effort()];
    if (random() % 10 != 0) f = TraceField::none();
  };
  add("updates lost", "90 % to the end", during(kToTheEnd, nine_in_ten), within_s(0.1)).blinds =
      true;
  add("bad update", "5 A, one", one_update(amperes(5)), unseen());
  for (const double a : {30.0, -30.0, 100.0})
    add("bad update", number(a) + " A, one", one_update(amperes(a)), within(16));
  add("bad update", "30 A, 1 in 1000 to the end", bad_updates(1000, amperes(30)), within(16));
  for (const double s : {0.002, 0.02, 0.4}) {
    const std::string size = number(1000 * s) + " ms";
    add("zero", size, during(s, effort_is(zero)), unseen());
    add("frozen", size, frozen(s), unseen());
    add("sign changed", size, during(s, effort_is(flipped)), unseen());
    add("at its limit", size, during(s, effort_is(at_limit)), unseen());
  }
  return all;
}

/// What still fails, in how many cells of the whole matrix at most, and why.
struct Open {
  Part part = Part::rows;
  std::string kind;
  Channel channel = Channel::machine;
  std::size_t late = 0, alarms = 0, missed = 0, repeated = 0;
  std::size_t shift = 0;  ///< programs with alarms in a shift of eight hours
  const char* reason = "";
};
inline const std::vector<Open> kOpen = {
    {Part::rows, "lost", Channel::machine, 0, 3, 0, 0, 7,
     "what was missed while the drive accelerates or the teeth cut is made up at once, within what "
     "the motion may do."},
    {Part::rows, "twice", Channel::machine, 0, 1, 0, 0, 0,
     "as rows that are lost: the row behind each is left out."},
    {Part::rows, "values exchanged", Channel::machine, 0, 6, 0, 0, 12,
     "to and fro by less than the speed changes in the cut."},
    {Part::time, "clock ahead", Channel::machine, 0, 3, 0, 0, 4,
     "by eight periods or fewer it looks like as many lost rows where the pace does not tell how "
     "many have passed."},
    {Part::time, "clock back", Channel::machine, 0, 2, 0, 0, 6,
     "as rows that are lost, behind the step."},
    {Part::motion, "invalid", Channel::x, 0, 0, 0, 0, 2, "as rows that are lost, of one drive."},
    {Part::motion, "stuck", Channel::x, 16, 22, 0, 0, 8,
     "at rest it cannot be told from rest, nor below 32 mm/s at 1 kHz (4 mm/s at 8 kHz) from a "
     "stop; the force that starts the axis then looks like a contact."},
    {Part::motion, "glitch out and back", Channel::spindle, 0, 15, 3, 0, 21,
     "counts beside the track by less than three times what the pace changes by are motion; the "
     "spindle in the air is quieter than that."},
    {Part::motion, "glitch of 3 samples", Channel::spindle, 0, 2, 0, 0, 36,
     "as glitches of one sample."},
    {Part::motion, "glitch of 3 samples", Channel::x, 0, 1, 0, 0, 15, "as glitches of one sample."},
    {Part::motion, "jump that stays", Channel::spindle, 0, 1, 0, 0, 56,
     "as glitches; a step of less than six times the usual change may be a push."},
    {Part::motion, "jump that stays", Channel::x, 0, 1, 0, 0, 26,
     "as glitches; a step of less than six times the usual change may be a push."},
    {Part::motion, "counter narrower", Channel::x, 0, 9, 0, 0, 5,
     "where it has not turned over yet it is right, and then the step is a bridge."},
    {Part::motion, "bit stuck", Channel::spindle, 0, 33, 5, 0, 28,
     "counts that are off by less than the speed changes, again and again."},
    {Part::motion, "bit stuck", Channel::x, 0, 19, 0, 0, 15,
     "counts that are off by less than the speed changes, again and again."},
    {Part::effort, "invalid", Channel::spindle, 0, 1, 0, 0, 0,
     "as silence, while the axis accelerates; met in the draws of the usual run."},
    {Part::effort, "invalid", Channel::x, 0, 2, 0, 0, 0,
     "as silence, while the axis accelerates; met in the draws of the usual run."},
    {Part::effort, "beyond any drive", Channel::x, 0, 1, 0, 0, 0,
     "as silence, while the axis accelerates."},
    {Part::effort, "silent", Channel::x, 0, 2, 0, 0, 0,
     "up to the limit of silence the last value stands, and a drive that accelerates meanwhile is "
     "short of force. (One of them in the draws of the usual run.)"},
    {Part::effort, "updates lost", Channel::x, 0, 1, 0, 0, 0, "as silence, again and again."},
    {Part::effort, "bad update", Channel::spindle, 0, 2, 0, 0, 3,
     "a step below three times the usual change of the current, or one of many that have become "
     "usual."},
    {Part::effort, "zero", Channel::spindle, 0, 1, 0, 0, 5,
     "in hard accelerations and cuts it is within what the current changes by."},
    {Part::effort, "zero", Channel::x, 0, 0, 0, 0, 3,
     "in hard accelerations and cuts it is within what the current changes by."},
    {Part::effort, "frozen", Channel::spindle, 0, 1, 0, 0, 1,
     "as silence, where values repeat by chance."},
    {Part::effort, "frozen", Channel::x, 0, 1, 0, 0, 3,
     "as silence, where values repeat by chance."},
    {Part::effort, "sign changed", Channel::spindle, 0, 14, 0, 0, 25,
     "a step of the current that stays is what a contact makes, too; a true one must not be "
     "missed."},
    {Part::effort, "sign changed", Channel::x, 0, 60, 0, 0, 43,
     "a step of the current that stays is what a contact makes, too; a true one must not be "
     "missed."},
    {Part::effort, "at its limit", Channel::spindle, 0, 1, 1, 0, 4, "as a changed sign."},
    {Part::effort, "at its limit", Channel::x, 0, 81, 0, 0, 46, "as a changed sign."},
};

[[nodiscard]] inline Open open_of(Part part, const std::string& kind, Channel channel) {
  for (const Open& o : kOpen)
    if (o.part == part && o.kind == kind && o.channel == channel) return o;
  Open none;
  none.part = part, none.kind = kind, none.channel = channel;
  return none;
}

/// As the page has it.
[[nodiscard]] inline std::string name(Channel channel) {
  return channel == Channel::machine ? "all" : std::string(servosense::name_of(channel));
}
/// That a fault is put on, one at a time.
[[nodiscard]] inline std::vector<Channel> channels_of(Part part) {
  if (part == Part::motion || part == Part::effort) return {Channel::spindle, Channel::x};
  return {Channel::machine};
}

}  // namespace faults
