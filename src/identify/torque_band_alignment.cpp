#include "torque_band_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
// Of two sections that are the same place of a program: speed, and length beside the shift.
constexpr double kSameSpeed = 0.05;
constexpr double kSameLength = 0.3;
// A run is like the first by its course or by its level.
constexpr double kSameCourse = 0.5;
constexpr double kSameLevel = 0.25;
constexpr double kMatchedLeast = 0.5;
// Points of a section that must meet points of the other run, and what it costs when they do not.
constexpr double kMetLeast = 0.8;
constexpr double kUnmet = 1e100;

struct Span {
  std::size_t from = 0, to = 0;
  TorqueRunSection section;
};

std::vector<Span> spans_of(const TorqueRun& run) {
  if (run.sections.empty()) return {{0, run.torque_Nm.size(), {}}};
  std::vector<Span> out;
  for (std::size_t i = 0; i < run.sections.size(); ++i) {
    const std::size_t to =
        i + 1 < run.sections.size() ? run.sections[i + 1].first : run.torque_Nm.size();
    out.push_back({run.sections[i].first, to, run.sections[i]});
  }
  return out;
}

bool same_place(const Span& a, const Span& b, double slack) {
  if (a.section.block != b.section.block) return false;
  const double speed = a.section.speed_rad_s;
  if (std::abs(speed - b.section.speed_rad_s) > kSameSpeed * std::abs(speed)) return false;
  const auto n = static_cast<double>(a.to - a.from), m = static_cast<double>(b.to - b.from);
  return std::abs(n - m) <= kSameLength * std::max(n, m) + slack;
}

/// Of each section of the first run its like in the other, in the same order, so that as much of
/// the program as possible has one.
std::vector<std::optional<std::size_t>> match(const std::vector<Span>& a,
                                              const std::vector<Span>& b, double slack) {
  const std::size_t n = a.size(), m = b.size();
  std::vector<std::optional<std::size_t>> out(n);
  bool alike = n == m;
  for (std::size_t i = 0; i < n && alike; ++i) {
    alike = n == 1 || same_place(a[i], b[i], slack);
    out[i] = i;
  }
  if (alike) return out;
  out.assign(n, std::nullopt);
  // Sections that lie farther apart in the order are not looked for.
  const std::size_t wide = 200 + (n > m ? n - m : m - n);
  std::vector<std::vector<float>> best(n + 1, std::vector<float>(m + 1, 0));
  const auto near = [&](std::size_t i, std::size_t k) { return i < k + wide && k < i + wide; };
  for (std::size_t i = n; i-- > 0;)
    for (std::size_t k = m; k-- > 0;) {
      best[i][k] = std::max(best[i + 1][k], best[i][k + 1]);
      if (!near(i, k) || !same_place(a[i], b[k], slack)) continue;
      const auto like = static_cast<float>(std::min(a[i].to - a[i].from, b[k].to - b[k].from));
      best[i][k] = std::max(best[i][k], best[i + 1][k + 1] + like);
    }
  for (std::size_t i = 0, k = 0; i < n && k < m;) {
    if (best[i][k] == best[i + 1][k])
      ++i;
    else if (best[i][k] == best[i][k + 1])
      ++k;
    else
      out[i++] = k++;
  }
  return out;
}

/// Beyond its ends a section is as at its ends, unless it is joined to its neighbour.
class Reading {
 public:
  Reading(const std::vector<double>& x, const Span& span, bool goes_on) : x_(x) {
    base_ = static_cast<double>(span.from);
    low_ = span.section.by_block ? 0 : base_;
    high_ = static_cast<double>(goes_on ? x_.size() - 1 : span.to - 1);
  }
  [[nodiscard]] double operator()(double at) const {
    const double x = std::clamp(base_ + at, low_, high_);
    const auto i = std::min(static_cast<std::size_t>(x), x_.size() - 1);
    const double part = x - static_cast<double>(i);
    if (part == 0 || i + 1 >= x_.size()) return x_[i];
    return x_[i] + part * (x_[i + 1] - x_[i]);
  }

 private:
  const std::vector<double>& x_;
  double base_ = 0, low_ = 0, high_ = 0;
};

/// Mean squared difference. A shift that lays the torque where the other run has none explains
/// nothing.
double difference(const std::vector<double>& first, std::size_t from, std::size_t to,
                  const Reading& other, double shift) {
  double sum = 0, n = 0, wanted = 0;
  for (std::size_t i = from; i < to; ++i) {
    if (!is_finite(first[i])) continue;
    wanted += 1;
    const double d = other(static_cast<double>(i) + shift) - first[i];
    if (is_finite(d)) sum += d * d, n += 1;
  }
  if (n < kMetLeast * wanted) return kUnmet;
  return n > 0 ? sum / n : 0;
}

double best_shift(const std::vector<double>& first, const Reading& other, int most) {
  const std::size_t n = first.size();
  int best = 0;
  double least = difference(first, 0, n, other, 0);
  for (int s = 1; s <= most; ++s)
    for (const int shift : {-s, s}) {
      const double d = difference(first, 0, n, other, shift);
      // A shift has to pay for itself: where the torque is flat, the ends decide.
      if (d < 0.98 * least) least = d, best = shift;
    }
  if (most == 0) return best;
  const double before = difference(first, 0, n, other, best - 1);
  const double after = difference(first, 0, n, other, best + 1);
  const double bend = before - 2 * least + after;
  const double rest = bend > 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
  return std::clamp(best + rest, -static_cast<double>(most), static_cast<double>(most));
}

/// Points over which a shift stays as it is.
std::size_t chunk_of(const AlignmentLimits& limits) {
  return static_cast<std::size_t>(std::ceil(1 / std::max(1e-3, limits.drift)));
}

/// Besides `shift`, whole points by which stretches of the section are late: no faster than the
/// drift allows (Bertok 1984 saw 1.2 %).
std::vector<int> drift_of(const std::vector<double>& first, const Reading& other, double shift,
                          const AlignmentLimits& limits) {
  const std::size_t chunk = chunk_of(limits);
  const std::size_t chunks = (first.size() + chunk - 1) / chunk;
  const int room = limits.most;
  std::vector<int> out(chunks, 0);
  if (chunks < 2 || room == 0) return out;
  // Of a drift between -room and room; neither sum can leave an int.
  const auto index_of = [&](int drift) {
    const int index = drift + room;
    return static_cast<std::size_t>(index);
  };
  const auto states = 2 * static_cast<std::size_t>(room) + 1;
  std::vector<std::vector<double>> cost(chunks, std::vector<double>(states, 1e300));
  std::vector<std::vector<int>> came(chunks, std::vector<int>(states, 0));
  for (std::size_t c = 0; c < chunks; ++c) {
    const std::size_t from = c * chunk, to = std::min(first.size(), from + chunk);
    for (int k = -room; k <= room; ++k) {
      const auto s = index_of(k);
      if (std::abs(shift + k) > room + 0.5) continue;
      double before = c == 0 ? 0 : 1e300;
      for (const int step : {0, -1, 1}) {
        if (c == 0 || k + step < -room || k + step > room) continue;
        const double past = cost[c - 1][index_of(k + step)];
        if (past < before) before = past, came[c][s] = step;
      }
      const double own = difference(first, from, to, other, shift + k);
      cost[c][s] = before + own * static_cast<double>(to - from);
    }
  }
  const auto& last = cost.back();
  auto at = static_cast<int>(std::min_element(last.begin(), last.end()) - last.begin());
  if (!(last[static_cast<std::size_t>(at)] < 0.98 *
                                                 difference(first, 0, first.size(), other, shift) *
                                                 static_cast<double>(first.size())))
    return out;
  for (std::size_t c = chunks; c-- > 0;) {
    out[c] = at - room;
    at += came[c][static_cast<std::size_t>(at)];
  }
  return out;
}

/// How like the first a run is, over all that has been laid over each other.
struct Likeness {
  double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
  void add(double x, double y) {
    if (!is_finite(x) || !is_finite(y)) return;
    n += 1, a += x, b += y, aa += x * x, bb += y * y, ab += x * y;
  }
  [[nodiscard]] bool alike() const {
    if (!(n > 0)) return false;
    const double va = aa - a * a / n, vb = bb - b * b / n;
    const double course = va > 0 && vb > 0 ? (ab - a * b / n) / std::sqrt(va * vb) : 0;
    const double off = std::max(0.0, aa - 2 * ab + bb);
    return course >= kSameCourse || off <= kSameLevel * kSameLevel * aa;
  }
};

}  // namespace

Expected<std::vector<AlignedSection>> align_runs(std::span<const TorqueRun> runs,
                                                 const AlignmentLimits& limits) {
  std::vector<std::vector<Span>> spans;
  for (const TorqueRun& run : runs) spans.push_back(spans_of(run));
  const std::vector<Span>& first = spans[0];
  std::vector<AlignedSection> out;
  for (std::size_t i = 0; i < first.size(); ++i) {
    AlignedSection s;
    s.from = first[i].from;
    s.to = first[i].to;
    s.speed_rad_s = first[i].section.speed_rad_s;
    s.friction_Nm = first[i].section.friction_Nm;
    s.joined = first[i].section.by_block;
    const auto begin = runs[0].torque_Nm.begin();
    s.torque_Nm.emplace_back(begin + static_cast<std::ptrdiff_t>(s.from),
                             begin + static_cast<std::ptrdiff_t>(s.to));
    s.feed.emplace_back();
    if (!runs[0].feed.empty()) {
      const auto feed = runs[0].feed.begin();
      s.feed[0].assign(feed + static_cast<std::ptrdiff_t>(s.from),
                       feed + static_cast<std::ptrdiff_t>(s.to));
    }
    s.shift.push_back(0);
    out.push_back(std::move(s));
  }
  const auto slack = 2.0 * limits.most;
  for (std::size_t r = 1; r < runs.size(); ++r) {
    const auto like = match(first, spans[r], slack);
    Likeness likeness;
    std::size_t points = 0, matched = 0;
    for (std::size_t i = 0; i < first.size(); ++i) {
      AlignedSection& s = out[i];
      const std::vector<double>& x = s.torque_Nm[0];
      const std::size_t n = s.to - s.from;
      points += n;
      if (!like[i]) {
        s.matched = false;
        s.torque_Nm.emplace_back(n, kNothing);
        s.feed.emplace_back();
        s.shift.push_back(0);
        continue;
      }
      matched += n;
      const std::size_t k = *like[i];
      const bool goes_on = k + 1 < spans[r].size() && spans[r][k + 1].section.by_block;
      const Reading other(runs[r].torque_Nm, spans[r][k], goes_on);
      // A section cannot be off by more than its length.
      const int most = std::min(i == 0 ? limits.most : limits.sync, static_cast<int>(n));
      const double shift = best_shift(x, other, most);
      const std::vector<int> drift = drift_of(x, other, shift, {most, most, limits.drift});
      std::vector<double> laid(n), feed(runs[r].feed.empty() ? 0 : n);
      double sum = 0;
      for (std::size_t p = 0; p < n; ++p) {
        const double by = shift + drift[p / chunk_of(limits)];
        laid[p] = other(static_cast<double>(p) + by);
        if (!feed.empty())
          feed[p] = Reading(runs[r].feed, spans[r][k], goes_on)(static_cast<double>(p) + by);
        sum += by;
        likeness.add(x[p], laid[p]);
      }
      s.torque_Nm.push_back(std::move(laid));
      s.feed.push_back(std::move(feed));
      s.shift.push_back(sum / static_cast<double>(n));
    }
    const std::string name = "run " + std::to_string(r + 1);
    if (!(static_cast<double>(matched) >= kMatchedLeast * static_cast<double>(points)))
      return data_error(name +
                        " has other blocks, speeds or lengths of cut than the first; leave it out");
    if (!likeness.alike())
      return data_error(name + " does not resemble the first within max_shift; leave it out");
  }
  return out;
}

}  // namespace servosense
