#include "servosense/identify/learn_pairs.hpp"

#include <algorithm>
#include <cmath>

#include "idle_regression.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/alarm_rate.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using idle_fit::Column;
using idle_fit::Columns;
using idle_fit::regress;
using idle_fit::Regression;

constexpr double kSameMotion = 0.01;  // that slopes of two sensors may differ by: a wrong lead
constexpr double kCorrelated = 0.98;  // less is another motion
constexpr double kOverLargest = 1.5;  // over the largest of the run, as of collision
constexpr double kOfEffort = 0.05;    // of the largest effort: friction that is warm or cold
constexpr double kOfFollowing = 0.05;
constexpr double kExpansion = 1e-4;          // of the travel: a screw of steel that warms up by 8 K
constexpr double kOfJerk = 1e-3;             // of the following error: what no term here takes
constexpr std::size_t kFewestSamples = 200;  // samples of a fit
constexpr double kCorrelated_s = 0.25;
constexpr double kFlank = 4;  // widths of the difference behind a reversal

using Regressor = double (*)(const PairSample&);
struct Term {
  double PairTerms::*member;
  Regressor of;
};
constexpr Term kZero{&PairTerms::zero, [](const PairSample&) { return 1.0; }};
constexpr Term kPosition{&PairTerms::position, [](const PairSample& s) { return s.position; }};
constexpr Term kVelocity{&PairTerms::velocity, [](const PairSample& s) { return s.velocity; }};
constexpr Term kAcceleration{&PairTerms::acceleration,
                             [](const PairSample& s) { return s.acceleration; }};
constexpr Term kDirection{&PairTerms::direction, [](const PairSample& s) { return s.direction; }};
constexpr Term kEffort{&PairTerms::effort, [](const PairSample& s) { return s.effort; }};
constexpr Term kCommandRate{&PairTerms::command_rate,
                            [](const PairSample& s) { return s.command_rate; }};

struct Fitted {
  PairTerms terms;
  Regression regression;
  std::vector<Column> columns;  // what the regression looked at
};

/// Some 250 samples a second make the rows over which residuals hang together.
std::size_t lag_of(const std::vector<const PairSample*>& rows) {
  if (rows.size() < 2) return 1;
  std::vector<double> steps;
  for (std::size_t i = 1; i < rows.size(); ++i) steps.push_back(rows[i]->t_s - rows[i - 1]->t_s);
  std::nth_element(steps.begin(), steps.begin() + static_cast<long>(steps.size() / 2), steps.end());
  return static_cast<std::size_t>(std::max(1.0, kCorrelated_s / steps[steps.size() / 2]));
}

/// Of `target` over the rows; columns that hold nothing are left out, their terms 0.
template <typename Target>
Fitted fit(const std::vector<const PairSample*>& rows, const std::vector<Term>& terms, bool curved,
           Target&& target, const std::vector<Column>& more = {}) {
  Fitted f;
  if (curved) {
    f.terms.low = f.terms.high = rows.front()->position;
    for (const PairSample* s : rows) {
      f.terms.low = std::min(f.terms.low, s->position);
      f.terms.high = std::max(f.terms.high, s->position);
    }
  }
  std::vector<std::size_t> of;  // the term of each column; beyond them the curve
  const auto take = [&](std::size_t term, Column column) {
    const auto [least, most] = std::minmax_element(column.begin(), column.end());
    if (term > 0 && !(*most > *least)) return;
    of.push_back(term);
    f.columns.push_back(std::move(column));
  };
  for (std::size_t t = 0; t < terms.size(); ++t) {
    Column column;
    for (const PairSample* s : rows) column.push_back(terms[t].of(*s));
    take(t, std::move(column));
  }
  if (curved)
    for (std::size_t n = 0; n < f.terms.curve.size(); ++n) {
      Column column;
      for (const PairSample* s : rows) column.push_back(f.terms.polynomials(s->position)[n]);
      take(terms.size() + n, std::move(column));
    }
  for (const Column& column : more) {
    of.push_back(terms.size() + 4 + of.size());
    f.columns.push_back(column);
  }
  Columns all;
  for (const Column& column : f.columns) all.push_back(&column);
  Column output;
  for (const PairSample* s : rows) output.push_back(target(*s));
  f.regression = regress(all, output, lag_of(rows));
  for (std::size_t c = 0; c < of.size(); ++c) {
    const double value = f.regression.parameters(static_cast<Eigen::Index>(c));
    if (of[c] < terms.size())
      f.terms.*terms[of[c]].member = value;
    else if (of[c] < terms.size() + 4)
      f.terms.curve[of[c] - terms.size()] = value;
  }
  return f;
}

Estimate estimate(const Fitted& f, std::size_t column) {
  const auto c = static_cast<Eigen::Index>(column);
  return {f.regression.parameters(c), f.regression.standard_errors(c)};
}

/// Standard error of the term of the velocity, of a law that is no straight line over it.
template <typename Target>
double moved_by_speed(const Fitted& f, const std::vector<const PairSample*>& rows,
                      Target&& target) {
  Columns all;
  for (const Column& column : f.columns) all.push_back(&column);
  Column output, speed;
  for (const PairSample* s : rows) {
    output.push_back(target(*s));
    speed.push_back(s->velocity);
  }
  return std::sqrt(std::max(0.0, idle_fit::moved_by_speeds(f.regression, all, output, speed)(1)));
}

std::vector<const PairSample*> rows_with(const PairRecord& record, PairKind kind) {
  std::vector<const PairSample*> rows;
  for (const PairSample& s : record.samples)
    if (s.settled && std::isfinite(s.difference[static_cast<std::size_t>(kind)]))
      rows.push_back(&s);
  return rows;
}

double difference_of(const PairSample& s, PairKind kind) {
  return s.difference[static_cast<std::size_t>(kind)];
}

/// The other sensor's travel over that of the motor, and how well they go together.
struct SameMotion {
  double ratio = 1, correlation = 1;
};
SameMotion compare(const std::vector<const PairSample*>& rows, double sign, PairKind kind) {
  double n = 0, x = 0, y = 0;
  for (const PairSample* s : rows) {
    ++n;
    x += (s->position - x) / n;
    y += (s->position + sign * difference_of(*s, kind) - y) / n;
  }
  double xx = 0, xy = 0, yy = 0;
  for (const PairSample* s : rows) {
    const double a = s->position - x, b = s->position + sign * difference_of(*s, kind) - y;
    xx += a * a;
    xy += a * b;
    yy += b * b;
  }
  if (!(xx > 0)) return {};
  return {xy / xx, yy > 0 ? xy / std::sqrt(xx * yy) : 0};
}

std::string mismatch(const PairRecord& record, const SameMotion& same, PairKind kind) {
  const Channel channel = record.columns.channel;
  const std::string who(name_of(channel));
  const std::string section = "[" + std::string(section_of(channel)) + "]";
  const std::string other = kind == PairKind::skew
                                ? "the motor of " + std::string(name_of(second_motor_of(channel)))
                            : is_turning(channel) ? who + ".angle_rad"
                                                  : who + ".position_m";
  if (std::abs(same.correlation) < kCorrelated)
    return who + ": " + other + " does not go with the motor (correlation " +
           printed(same.correlation) + "); check which columns are of this drive, and its coupling";
  if (same.ratio < 0)
    return who + ": " + other + " counts against the motor (ratio " + printed(same.ratio) +
           "); turn the sign of one of the two columns, the one that the effort does not go with";
  if (std::abs(same.ratio - 1) < kSameMotion) return {};
  if (kind == PairKind::skew)
    return who + ": " + other + " moves " + printed(same.ratio) +
           " times as far as the first; both have to count alike, so scale its column";
  const bool linear = !is_turning(channel);
  return who + ": " + other + " moves " + printed(same.ratio) +
         " times as far as the motor says; correct " +
         (linear ? "lead_m (times " + printed(same.ratio) + "), " : std::string()) +
         "encoder_counts_per_rev (divided by it) or gear_ratio (divided by it) in " + section +
         (linear ? "" : ", or the column");
}

/// Rows in which the load lies on the flank that the motion says, and which one (-1, 1).
struct OnFlank {
  std::vector<const PairSample*> rows;
  Column side;
};
OnFlank on_flank(const std::vector<const PairSample*>& rows, double width,
                 const PairTerms& idle_effort) {
  const double hard = idle_effort.acceleration > 0
                          ? 0.5 * idle_effort.direction / idle_effort.acceleration
                          : std::numeric_limits<double>::infinity();
  // The filter remembers what was before for so long.
  constexpr double kMemory_s = 6 / PairReader::kCutoff_rad_s;
  OnFlank found;
  double side = 0, from = 0, since_s = 0;
  for (const PairSample* s : rows) {
    const double now = s->direction > 0.99 ? 1 : s->direction < -0.99 ? -1 : 0;
    const bool braked = s->acceleration * side < -hard;
    if (now == 0 || now != side || braked) {
      side = now;
      from = s->position;
      since_s = s->t_s;
    }
    if (side == 0 || std::abs(s->position - from) < kFlank * width || s->t_s - since_s < kMemory_s)
      continue;
    found.rows.push_back(s);
    found.side.push_back(side);
  }
  return found;
}

/// How far a difference wanders, a slope taken off.
double width_of(const std::vector<const PairSample*>& rows, PairKind kind) {
  const auto target = [&](const PairSample& s) { return difference_of(s, kind); };
  const Fitted line = fit(rows, {kZero, kPosition, kVelocity}, false, target);
  double low = 0, high = 0;
  for (const PairSample* s : rows) {
    const double r = target(*s) - line.terms.at(*s);
    low = std::min(low, r);
    high = std::max(high, r);
  }
  return high - low;
}

double travel_of(const std::vector<const PairSample*>& rows) {
  const auto by_position = [](const PairSample* a, const PairSample* b) {
    return a->position < b->position;
  };
  const auto [low, high] = std::minmax_element(rows.begin(), rows.end(), by_position);
  return (*high)->position - (*low)->position;
}

Estimate amplitude(const Estimate& sine, const Estimate& cosine) {
  return {std::hypot(sine.value, cosine.value),
          std::max(sine.standard_error, cosine.standard_error)};
}

/// Square of the frequency that the acceleration goes with [rad2/s2].
double quickness(const std::vector<const PairSample*>& rows) {
  constexpr double kAdjacent_s = 0.02;
  double changes = 0, squares = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const double dt = rows[i]->t_s - rows[i - 1]->t_s;
    if (!(dt > 0 && dt < kAdjacent_s)) continue;
    const double change = (rows[i]->acceleration - rows[i - 1]->acceleration) / dt;
    changes += change * change;
    squares += rows[i]->acceleration * rows[i]->acceleration;
  }
  return squares > 0 ? changes / squares : 0;
}

/// Nothing where too few rows lie on a flank for sure.
std::optional<LoadPath> load_path(const PairRecord& record,
                                  const std::vector<const PairSample*>& rows, bool with_effort,
                                  const PairTerms& idle_effort, PairTerms& terms) {
  const OnFlank flank = on_flank(rows, width_of(rows, PairKind::load), idle_effort);
  const auto both = [&](double side) {
    return std::ranges::count(flank.side, side) > static_cast<long>(kFewestSamples / 4);
  };
  if (flank.rows.size() < kFewestSamples || !both(-1) || !both(1)) return std::nullopt;
  const double turn = record.unit_per_turn;
  const bool cyclic = turn > 0 && travel_of(flank.rows) > 1.5 * turn;
  std::vector<Term> plain = {kZero, kPosition, kVelocity};
  if (with_effort) plain.push_back(kEffort);
  std::vector<Column> more = {flank.side};
  if (cyclic)
    for (std::size_t n = 0; n < 4; ++n) {
      Column wave;
      for (const PairSample* s : flank.rows) wave.push_back(s->turn[n]);
      more.push_back(std::move(wave));
    }
  const Fitted f = fit(
      flank.rows, plain, false,
      [](const PairSample& s) { return difference_of(s, PairKind::load); }, more);
  terms = f.terms;
  LoadPath path;
  path.slope = estimate(f, 1);
  const Estimate side = estimate(f, plain.size());
  path.backlash = {-2 * side.value, 2 * side.standard_error};
  if (with_effort) {
    const Estimate per_effort = estimate(f, 3);
    const double windup = 2 * (std::abs(per_effort.value) + per_effort.standard_error) *
                          std::abs(idle_effort.direction);
    path.backlash.standard_error = std::hypot(path.backlash.standard_error, windup);
    const double c = -per_effort.value;
    if (c > 3 * per_effort.standard_error) {
      // The load swings after the motor: windup is that of a steady acceleration but for the square
      // of its frequency over that of the load, there and back.
      const double swings = 2 * quickness(flank.rows) * c * std::max(idle_effort.acceleration, 0.0);
      const double relative = std::hypot(per_effort.standard_error / c, swings);
      path.effort_per_difference = {1 / c, relative / c};
      if (idle_effort.acceleration > 0) {
        const double hz = std::sqrt(1 / (c * idle_effort.acceleration)) / kTwoPi;
        path.held_resonance_hz = {hz, hz * relative / 2};
      }
    }
  }
  if (cyclic)
    for (std::size_t n = 0; n < 2; ++n)
      path.cyclic[n] =
          amplitude(estimate(f, plain.size() + 1 + 2 * n), estimate(f, plain.size() + 2 + 2 * n));
  return path;
}

/// The band of a pair whose terms are found.
LearnedPair banded(const PairRecord& record, PairKind kind, const PairTerms& terms,
                   const std::vector<const PairSample*>& rows, double rate_per_hour) {
  LearnedPair learned{kind, terms, 0, 0};
  double low = 0, high = 0, most_difference = 0, most_effort = 0, last_s = 0;
  const double step_s = static_cast<double>(lag_of(rows)) > 0
                            ? kCorrelated_s / static_cast<double>(lag_of(rows))
                            : kCorrelated_s;
  AlarmRate noise(static_cast<unsigned>(std::max(1.0, PairWatch::kHold_s / step_s)));
  for (const PairSample* s : rows) {
    const double r = difference_of(*s, kind) - terms.at(*s);
    if (s == rows.front()) low = high = r;
    low = std::min(low, r);
    high = std::max(high, r);
    most_difference = std::max(most_difference, std::abs(difference_of(*s, kind)));
    most_effort = std::max(most_effort, std::abs(s->effort));
    if (s->t_s - last_s > 3 * step_s) noise.interrupt();
    noise.add(r, step_s);
    last_s = s->t_s;
  }
  const double counts = 2 * std::abs(record.unit_per_count);
  if (kind == PairKind::load || kind == PairKind::skew) {
    learned.largest = high - low;
    learned.band = kOverLargest * learned.largest + kExpansion * travel_of(rows) + counts;
    return learned;
  }
  learned.largest = std::max(high, -low);
  const double floor = kind == PairKind::following ? kOfFollowing * most_difference + counts
                                                   : kOfEffort * most_effort;
  learned.band = std::max(
      {kOverLargest * learned.largest, learned.largest + floor, noise.level(rate_per_hour)});
  return learned;
}

}  // namespace

Expected<LearnedPairs> learn_pairs(const PairRecord& record, bool effort_has_sign,
                                   double false_alarm_rate_per_hour) {
  LearnedPairs found;
  const std::string who(name_of(record.columns.channel));
  std::vector<const PairSample*> all;
  for (const PairSample& s : record.samples)
    if (s.settled) all.push_back(&s);
  if (all.size() < kFewestSamples || !(travel_of(all) > 0)) return found;
  if (effort_has_sign)
    found.idle_effort =
        fit(all, {kZero, kVelocity, kAcceleration, kDirection}, false, [](const PairSample& s) {
          return s.effort;
        }).terms;
  for (std::size_t k = 0; k < kPairKinds; ++k) {
    const auto kind = static_cast<PairKind>(k);
    const std::vector<const PairSample*> rows = rows_with(record, kind);
    if (rows.size() < kFewestSamples) continue;
    const auto target = [&](const PairSample& s) { return difference_of(s, kind); };
    if (kind == PairKind::load || kind == PairKind::skew) {
      const SameMotion same = compare(rows, kind == PairKind::load ? 1 : -1, kind);
      if (std::string wrong = mismatch(record, same, kind); !wrong.empty())
        return data_error(std::move(wrong));
    }
    if (kind == PairKind::skew_effort && !effort_has_sign) continue;
    PairTerms terms;
    switch (kind) {
      case PairKind::load: {
        found.load = load_path(record, rows, effort_has_sign, found.idle_effort, terms);
        if (found.load) break;
        terms = fit(rows, {kZero, kPosition, kVelocity}, false, target).terms;
        found.remarks.push_back(who +
                                ": too little of the record lies on one flank for sure, so motor "
                                "and scale say nothing of backlash; record longer moves both ways");
        break;
      }
      case PairKind::skew:
        terms =
            fit(rows, {kZero, kPosition, kVelocity, kAcceleration, kDirection}, true, target).terms;
        break;
      case PairKind::skew_effort:
        terms =
            fit(rows, {kZero, kPosition, kVelocity, kAcceleration, kDirection}, true, target).terms;
        break;
      case PairKind::following: {
        const Fitted f = fit(rows, {kZero, kVelocity, kAcceleration, kDirection}, false, target);
        terms = f.terms;
        Estimate time = estimate(f, 1);
        time.standard_error =
            std::hypot(time.standard_error, moved_by_speed(f, rows, target), kOfJerk * time.value);
        if (std::abs(time.value) > 3 * time.standard_error) found.following_time_s = time;
        if (time.value < -3 * time.standard_error)
          found.remarks.push_back(who +
                                  ": the following error falls as the drive moves forward: it is "
                                  "actual less commanded here, or feed forward does too much");
        break;
      }
      case PairKind::command: {
        // A lag is no delay: its next term is told apart.
        Column curvature;
        for (const PairSample* row : rows) curvature.push_back(row->command_curvature);
        const Fitted f = fit(rows, {kZero, kCommandRate}, false, target, {curvature});
        terms = f.terms;
        if (f.columns.size() == 3) {
          // What is not told apart moves the two fits against each other.
          const Estimate rate = estimate(f, 1);
          const Fitted plain = fit(rows, {kZero, kCommandRate}, false, target);
          found.command_delay_s = Estimate{
              -rate.value,
              std::hypot(rate.standard_error, 2 * (estimate(plain, 1).value - rate.value))};
        }
        break;
      }
    }
    found.pairs.push_back(banded(record, kind, terms, rows, false_alarm_rate_per_hour));
  }
  return found;
}

}  // namespace servosense
