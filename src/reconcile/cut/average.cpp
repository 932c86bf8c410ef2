#include "reconcile/cut/average.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "servosense/core/units.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kSameSpeed = 0.03;
constexpr std::size_t kMostSpeedLevels = 24;
/// Usual is what this share of the revolutions does not exceed: half a record may be air.
constexpr double kUsualTurn = 0.8;
/// Of the way out. A force the same all over the arc of a slot has fallen by half after 0.62.
constexpr double kThickest = 0.65;
constexpr std::size_t kMostBins = 360, kLeastBins = 24;
constexpr double kSamplesPerBin = 8;  // of a level

struct Turn {
  std::size_t first = 0, last = 0;  // samples
  double feed = 0, speed = 0, rms = 0;
  std::size_t level = CutAverage::kNone;
};

/// How many revolutions at the beginning of a pass are beyond `most`: a third of it at the most.
std::size_t unsettled(const std::vector<double>& turns, double most) {
  std::size_t count = 0;
  while (count < turns.size() / 3 && turns[count] > most) ++count;
  return count;
}

/// Whole revolutions at one feed, without gaps.
std::vector<Turn> turns_of(const CuttingData& d, const Criteria& criteria) {
  std::vector<Turn> turns;
  const std::size_t n = d.time_s.size();
  std::size_t i = 0;
  while (i < n && !d.valid[i]) ++i;
  while (i < n) {
    const double turn = std::floor(d.angle_rad[i] / kTwoPi);
    Turn t;
    t.first = i;
    double least = d.feed_per_tooth_m[i], most = least, square = 0;
    std::size_t good = 0;
    while (i < n && (!d.valid[i] || std::floor(d.angle_rad[i] / kTwoPi) == turn)) {
      if (d.valid[i]) {
        least = std::min(least, d.feed_per_tooth_m[i]);
        most = std::max(most, d.feed_per_tooth_m[i]);
        square += d.force_x_N[i] * d.force_x_N[i] + d.force_y_N[i] * d.force_y_N[i];
        ++good;
      }
      ++i;
    }
    t.last = i;
    const std::size_t all = t.last - t.first;
    if (good < 4 || good * 10 < all * 9 || most > least * (1 + criteria.same_feed) ||
        t.first == 0 || i >= n)
      continue;
    t.feed = 0.5 * (least + most);
    t.speed = kTwoPi / (d.time_s[i] - d.time_s[t.first]);
    t.rms = std::sqrt(square / static_cast<double>(2 * good));
    turns.push_back(t);
  }
  return turns;
}

/// Entry and a change of feed ring on: steady is a cut from the revolution on that repeats the one
/// before it as well as later ones do.
void drop_transients(const CuttingData& d, std::vector<Turn>& turns, const Criteria& criteria) {
  constexpr std::size_t kCoarse = 24;
  using Shape = std::array<double, 2 * kCoarse>;
  const auto shape_of = [&](const Turn& t) {
    Shape sum{}, count{};
    for (std::size_t i = t.first; i < t.last; ++i) {
      if (!d.valid[i]) continue;
      const double turn = d.angle_rad[i] / kTwoPi;
      const auto k =
          std::min(static_cast<std::size_t>((turn - std::floor(turn)) * kCoarse), kCoarse - 1);
      sum[k] += d.force_x_N[i];
      sum[kCoarse + k] += d.force_y_N[i];
      ++count[k];
      ++count[kCoarse + k];
    }
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] /= std::max(1.0, count[k]);
    return sum;
  };
  for (std::size_t k = 0; k < turns.size();) {
    std::size_t end = k + 1;
    while (end < turns.size() && turns[end].level == turns[k].level) ++end;
    std::vector<double> change;  // from one revolution to the next
    Shape before = shape_of(turns[k]);
    for (std::size_t t = k + 1; t < end; ++t) {
      const Shape now = shape_of(turns[t]);
      double square = 0;
      for (std::size_t j = 0; j < now.size(); ++j)
        square += (now[j] - before[j]) * (now[j] - before[j]);
      change.push_back(square);
      before = now;
    }
    if (turns[k].level != CutAverage::kNone && change.size() >= 4) {
      const std::size_t settled = unsettled(change, criteria.unsettled * quantile(change, 0.5));
      for (std::size_t t = k; t < k + settled; ++t) turns[t].level = CutAverage::kNone;
    }
    k = end;
  }
}

/// Feed between the first touch of a face and the whole arc in the work.
double entry_m(const CuttingData& d) {
  const Engagement arc = engagement_of(d.tool, d.cut);
  const double first = std::sin(arc.start_rad), last = std::sin(arc.exit_rad);
  const bool past_front = arc.start_rad < kPi / 2 && arc.exit_rad > kPi / 2;
  return d.tool.radius_m() * ((past_front ? 1 : std::max(first, last)) - std::min(first, last));
}

/// Next to air the tool is still entering the work, or leaves it already: too slowly to be seen
/// from one revolution to the next, but for as long as its geometry says.
void drop_entries(const CuttingData& d, std::vector<Turn>& turns, const std::vector<bool>& air) {
  const double whole_m = entry_m(d);
  const auto drop = [&](std::size_t k, double& since_m, double slow_m) {
    if (since_m <= slow_m || air[k]) turns[k].level = CutAverage::kNone;
    since_m = air[k] ? 0 : since_m + turns[k].feed * d.tool.teeth;
  };
  double since_m = 2 * whole_m + 1;
  for (std::size_t k = 0; k < turns.size(); ++k) drop(k, since_m, whole_m);
  since_m = 2 * whole_m + 1;
  // The thickest chips leave first: the force has fallen by half within kThickest of it.
  for (std::size_t k = turns.size(); k > 0; --k) drop(k - 1, since_m, kThickest * whole_m);
}

/// Levels in the order of their coming, as fine as their number allows: force goes with the feed.
Expected<Done> find_levels(std::vector<Turn>& turns, CutAverage& a) {
  for (const auto& [same_feed, by_speed] : {std::pair{0.001, true}, std::pair{0.004, true},
                                            std::pair{0.004, false}, std::pair{0.015, false}}) {
    a.levels.clear();
    for (Turn& t : turns) {
      std::size_t l = 0;
      while (l < a.levels.size() &&
             !(std::abs(t.feed / a.levels[l].feed_per_tooth_m - 1) < same_feed &&
               (!by_speed || std::abs(t.speed / a.levels[l].speed_rad_s - 1) < kSameSpeed)))
        ++l;
      if (l == a.levels.size()) a.levels.push_back({t.feed, t.speed, 0, {}});
      t.level = l;
    }
    if (a.levels.size() <= kMostSpeedLevels) break;
  }
  if (a.levels.size() > kMostSpeedLevels)
    return data_error(
        "the feed per tooth never stays; record some seconds of steady cutting at each of a few "
        "feeds");
  return Done{};
}

/// Which revolutions are air.
std::vector<bool> air_turns(const std::vector<Turn>& turns, const CutAverage& a,
                            const Criteria& criteria) {
  std::vector<double> usual(a.levels.size(), 0);
  for (std::size_t l = 0; l < a.levels.size(); ++l) {
    std::vector<double> rms;
    for (const Turn& t : turns)
      if (t.level == l) rms.push_back(t.rms);
    usual[l] = quantile(std::move(rms), kUsualTurn);
  }
  // A level may be air alone. Force grows with the feed, and no faster.
  if (!usual.empty()) {
    const auto most =
        static_cast<std::size_t>(std::max_element(usual.begin(), usual.end()) - usual.begin());
    for (std::size_t l = 0; l < a.levels.size(); ++l)
      usual[l] =
          std::max(usual[l], usual[most] * std::min(1.0, a.levels[l].feed_per_tooth_m /
                                                             a.levels[most].feed_per_tooth_m));
  }
  std::vector<bool> air(turns.size(), false);
  for (std::size_t k = 0; k < turns.size(); ++k)
    air[k] = turns[k].rms < criteria.air_force * usual[turns[k].level];
  return air;
}

/// Steady revolutions, and samples of the level with the fewest.
struct Kept {
  double turns = 0, least_samples = 1e300;
};
/// Drops levels that are mere transitions, and sums up the others.
Kept keep_levels(std::vector<Turn>& turns, CutAverage& a, const Criteria& criteria) {
  std::vector<double> per_level(a.levels.size(), 0);
  std::vector<double> turns_in(a.levels.size(), 0), speed(a.levels.size(), 0),
      feed(a.levels.size(), 0);
  for (const Turn& t : turns) {
    if (t.level == CutAverage::kNone) continue;
    per_level[t.level] += static_cast<double>(t.last - t.first);
    speed[t.level] += t.speed;
    feed[t.level] += t.feed;
    ++turns_in[t.level];
  }
  Kept kept;
  for (std::size_t l = 0; l < a.levels.size(); ++l) {
    if (turns_in[l] < criteria.least_turns / 4) {  // a transition
      for (Turn& t : turns)
        if (t.level == l) t.level = CutAverage::kNone;
      continue;
    }
    kept.turns += turns_in[l];
    a.levels[l].speed_rad_s = speed[l] / turns_in[l];
    a.levels[l].feed_per_tooth_m = feed[l] / turns_in[l];
    a.levels[l].samples_per_turn = per_level[l] / turns_in[l];
    kept.least_samples = std::min(kept.least_samples, per_level[l]);
  }
  return kept;
}

/// The end of the record is kept for the proof.
void add_blocks(const CuttingData& d, const std::vector<Turn>& turns, const Options& options,
                CutAverage& a) {
  std::vector<const Turn*> steady;
  for (const Turn& t : turns)
    if (t.level != CutAverage::kNone) steady.push_back(&t);
  const auto split =
      static_cast<std::size_t>((1 - options.held_out_share) * static_cast<double>(steady.size()));
  const std::size_t per_block = std::max<std::size_t>(2, split / std::max(1U, options.blocks));
  a.held_from_s = d.time_s[steady[split]->first];
  a.held_to_s = d.time_s[steady.back()->last - 1];
  a.block_of.assign(d.time_s.size(), CutAverage::kNone);
  a.level_of = a.block_of;

  std::vector<std::vector<double>> angles(a.levels.size());
  for (std::size_t k = 0; k < steady.size();) {
    std::size_t end = k + 1;
    const bool held = k >= split;
    while (end < steady.size() && end - k < per_block && steady[end]->level == steady[k]->level &&
           (end >= split) == held)
      ++end;
    if (end - k >= 2) {
      const double middle_s =
          0.5 * (d.time_s[steady[k]->first] + d.time_s[steady[end - 1]->last - 1]);
      for (std::size_t t = k; t < end; ++t)
        for (std::size_t i = steady[t]->first; i < steady[t]->last; ++i) {
          if (!d.valid[i]) continue;
          a.block_of[i] = a.blocks.size();
          a.level_of[i] = steady[k]->level;
          if (held) continue;
          const double turn = d.angle_rad[i] / kTwoPi;
          angles[steady[k]->level].push_back(kTwoPi * (turn - std::floor(turn)));
        }
      for (std::size_t t = k; t < end; ++t) {
        const bool goes_on = t > 0 && steady[t - 1]->level == steady[t]->level &&
                             steady[t - 1]->last == steady[t]->first;
        a.turns.push_back({steady[t]->first, steady[t]->last, a.blocks.size(), !goes_on});
      }
      a.blocks.push_back({steady[k]->level, held, middle_s, {}, {}});
    }
    k = end;
  }
  for (std::size_t l = 0; l < a.levels.size(); ++l)
    a.levels[l].angles = BinnedAngles(std::move(angles[l]), a.bins);
}

}  // namespace

Expected<CutAverage> average(const CuttingData& d, const Options& options) {
  const Criteria& criteria = options.criteria;
  CutAverage a;
  std::vector<Turn> turns = turns_of(d, criteria);

  if (auto found = find_levels(turns, a); !found) return found.error();
  const std::vector<bool> air = air_turns(turns, a, criteria);
  drop_entries(d, turns, air);
  drop_transients(d, turns, criteria);
  const Kept kept = keep_levels(turns, a, criteria);
  if (kept.turns < criteria.least_turns)
    return data_error(
        "only " + std::to_string(static_cast<int>(kept.turns)) +
        " revolutions of steady cutting; record at least 60 at each feed" +
        (std::find(air.begin(), air.end(), true) == air.end()
             ? ""
             : ", beyond the " + printed(1e3 * entry_m(d)) + " mm of entry and of exit"));

  a.bins = std::clamp(static_cast<std::size_t>(kept.least_samples / kSamplesPerBin), kLeastBins,
                      kMostBins);

  add_blocks(d, turns, options, a);
  average_again(a, d, {}, criteria);
  return a;
}

std::pair<Eigen::VectorXd, Eigen::VectorXd> CutAverage::mean_of(std::size_t level,
                                                                bool held_out) const {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(2 * bins)), count = sum;
  for (const CutBlock& b : blocks) {
    if (b.held_out != held_out || b.level != level) continue;
    sum += b.count.cwiseProduct(b.mean);
    count += b.count;
  }
  return {sum.cwiseQuotient(count.cwiseMax(1.0)), count};
}

Eigen::Index CutAverage::bin_of(double angle_rad) const {
  const double turn = angle_rad / kTwoPi;
  return std::min(static_cast<Eigen::Index>((turn - std::floor(turn)) * static_cast<double>(bins)),
                  static_cast<Eigen::Index>(bins) - 1);
}

namespace {

/// What rings many times a revolution hardly shows in coarse means, and from one revolution to the
/// next samples fall elsewhere in the wave: only a model tells that a pass has not settled yet.
void drop_ringing(CutAverage& a, const CuttingData& d, const CutPrediction& p,
                  const Criteria& criteria) {
  for (std::size_t k = 0; k < a.turns.size();) {
    std::size_t end = k + 1;
    while (end < a.turns.size() && !a.turns[end].begins) ++end;
    std::vector<double> left;
    double samples = 0;
    for (std::size_t t = k; t < end; ++t) {
      double square = 0, n = 0;
      for (std::size_t i = a.turns[t].first; i < a.turns[t].last; ++i) {
        if (!d.valid[i]) continue;
        square += std::pow(d.force_x_N[i] - p.x_N[i], 2) + std::pow(d.force_y_N[i] - p.y_N[i], 2);
        n += 2;
      }
      left.push_back(square / n);
      samples += n / static_cast<double>(end - k);
    }
    const double most = (1 + criteria.still_rings * std::sqrt(2 / samples)) * quantile(left, 0.5);
    const std::size_t settled = unsettled(left, most);
    for (std::size_t t = k; t < end; ++t)
      for (std::size_t i = a.turns[t].first; i < a.turns[t].last; ++i)
        if (d.valid[i]) a.block_of[i] = t < k + settled ? CutAverage::kNone : a.turns[t].block;
    k = end;
  }
}

}  // namespace

void average_again(CutAverage& a, const CuttingData& d, const CutPrediction& p,
                   const Criteria& criteria) {
  if (!p.x_N.empty()) drop_ringing(a, d, p, criteria);
  const auto bins = static_cast<Eigen::Index>(a.bins);
  for (CutBlock& block : a.blocks) block.mean = block.count = Eigen::VectorXd::Zero(2 * bins);
  // Noise: from one revolution to the next at the same angle, so that what drifts does not count
  // (von Neumann et al. 1941).
  std::vector<Eigen::VectorXd> last(a.levels.size(),
                                    Eigen::VectorXd::Constant(2 * bins, std::nan("")));
  double differences = 0, pairs = 0;
  for (std::size_t i = 0; i < a.block_of.size(); ++i) {
    if (a.block_of[i] == CutAverage::kNone) continue;
    CutBlock& block = a.blocks[a.block_of[i]];
    const Eigen::Index b = a.bin_of(d.angle_rad[i]);
    const auto add = [&](Eigen::Index row, double value) {
      block.mean(row) += (value - block.mean(row)) / ++block.count(row);
      if (block.held_out) return;
      double& before = last[block.level](row);
      if (std::isfinite(before)) {
        differences += (value - before) * (value - before);
        ++pairs;
      }
      before = value;
    };
    add(b, d.force_x_N[i] - (p.x_N.empty() ? 0 : p.x_N[i]));
    add(bins + b, d.force_y_N[i] - (p.y_N.empty() ? 0 : p.y_N[i]));
  }
  double square = 0, total = 0;
  for (CutBlock& block : a.blocks) {
    if (!p.bins.empty()) block.mean += p.bins[block.level];
    if (block.held_out) continue;
    square += (block.count.array() * block.mean.array().square()).sum();
    total += block.count.sum();
  }
  a.noise_N = pairs > 0 ? std::sqrt(differences / pairs / 2) : 0;
  a.effort_N = std::sqrt(square / std::max(1.0, total));
}

}  // namespace servosense::reconcile
