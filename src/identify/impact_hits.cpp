#include "impact_hits.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "impact_range.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/io/text.hpp"

namespace servosense::impact {
namespace {

constexpr double kFewestSamples = 5;   // of a pulse, above a tenth of its peak
constexpr double kFewestSteps = 50;    // of the converter: 1 % of rounding
constexpr double kHitAboveNoise = 20;  // peak of the force, in standard deviations
constexpr double kLeastOfUsual = 0.2;  // a weaker hit is not the blow of the others
constexpr double kHeard = 2;           // strongest block of the response over the noise
constexpr double kMoves = 0.05;        // of the strongest block: before the blow
constexpr double kMovesOverRest = 3;   // times the rest of the others
constexpr double kMostLeft = 0.3;      // at the end: a window cannot replace what was not recorded
constexpr double kLeastEnd = 0.01;     // at the end: what follows may be taken to be zero
constexpr double kAlike = 0.7;         // of the usual length: shorter ones do not shorten all
constexpr double kLongest = 16;        // times what a response lasts

std::string milliseconds(double s) { return printed(1e3 * s, 3) + " ms"; }
std::string percent(double share) { return printed(100 * share, 2) + " %"; }

/// What the force alone says against a hit; empty: nothing.
std::string judged_by_force(const ImpactRecord& record, const ForceRecord& force, const Blow& blow,
                            double step_N) {
  const double rate = record.sample_rate_hz;
  const ForcePulse& p = blow.pulse;
  const double peak = std::abs(p.peak_N);
  if (p.before == 0 || p.after == 0)
    return p.before == 0 ? "record: it begins within the pulse; let it start earlier (pre-trigger)"
                         : "record: it ends within the pulse; record longer";
  if (blow.doubled) {
    const bool later = blow.second.peak > p.peak;
    const double apart =
        static_cast<double>(later ? blow.second.peak - p.peak : p.peak - blow.second.peak) / rate;
    return "double hit: a contact of " + percent(std::abs(blow.second.peak_N) / peak) + " comes " +
           milliseconds(apart) + (later ? " later" : " earlier");
  }
  const ForceWindow window(p);
  const auto from = static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, window.begin()));
  const auto to = std::min(force.force_N.size(), static_cast<std::size_t>(window.end()));
  for (std::size_t i = from; i < to; ++i)
    if (!force.known[i])
      return "overload: the force has no value at " +
             printed(record.begin_s + static_cast<double>(i) / rate, 6) + " s";
  if (cut_off(std::span(record.force_N).subspan(from, to - from), p.peak_N < 0 ? -1 : 1, step_N,
              force.noise_N))
    return "overload: the force is cut off at " + printed(peak, 4) +
           " N; choose a wider range, or hit more softly";
  if (static_cast<double>(p.before + p.after) < kFewestSamples)
    return "sampling: its pulse of " +
           milliseconds(static_cast<double>(p.before + p.after) / rate) + " has " +
           std::to_string(p.before + p.after) + " samples; record faster";
  if (peak < kFewestSteps * step_N)
    return "wrong range: the peak of the force is " + printed(peak / step_N, 3) +
           " steps of the converter; choose a narrower range";
  if (peak < kHitAboveNoise * force.noise_N)
    return "weak: the peak of the force is " + printed(peak / force.noise_N, 3) +
           " times its noise; hit harder";
  return {};
}

/// What the response says against it, before its length is known.
std::string judged_by_response(const ImpactRecord& record, const JudgedHit& h, double step,
                               double rest) {
  const std::span<const double> own =
      std::span(record.response).subspan(h.hit.begin, h.end - h.hit.begin);
  for (std::size_t i = 0; i < own.size(); ++i)
    if (!std::isfinite(own[i]))
      return "overload: the response has no value at " +
             printed(record.begin_s + static_cast<double>(h.hit.begin + i) / record.sample_rate_hz,
                     6) +
             " s";
  for (const double sign : {1.0, -1.0})
    if (cut_off(own, sign, step, rest))
      return "overload: the response is cut off; choose a wider range, or hit more softly";
  const auto [low, high] = std::minmax_element(own.begin(), own.end());
  if (*high - *low < kFewestSteps * step)
    return "wrong range: the response is " + printed((*high - *low) / step, 3) +
           " steps of the converter; choose a narrower range";
  if (std::isfinite(h.response.quiet) && h.response.highest < kHeard * rest)
    return "weak: the response is not above its noise; hit harder";
  if (h.response.quiet > kMoves * h.response.highest && h.response.quiet > kMovesOverRest * rest)
    return "not at rest: the tool still moved before the hit; wait longer between hits";
  return {};
}

/// All blows, with the samples that are their own.
void find_hits(std::span<const ImpactRecord> records, JudgedHits& all) {
  for (std::size_t r = 0; r < records.size(); ++r) {
    const ImpactRecord& record = records[r];
    all.force.push_back(force_record(record.force_N, record.sample_rate_hz));
    const ForceRecord& force = all.force.back();
    const double step = smallest_step(record.force_N);
    const auto time_of = [&](std::size_t sample) {
      return record.begin_s + static_cast<double>(sample) / record.sample_rate_hz;
    };
    const std::vector<Blow> blows = find_blows(force, record.sample_rate_hz);
    std::size_t free_from = 0;
    for (std::size_t b = 0; b < blows.size(); ++b) {
      const ForcePulse& p = blows[b].pulse;
      const ForceWindow window(p);
      JudgedHit h;
      h.hit.record = r, h.hit.t_s = time_of(p.peak), h.hit.peak_N = p.peak_N;
      h.hit.width_s = static_cast<double>(p.before + p.after) / record.sample_rate_hz;
      h.hit.peak = p.peak, h.pulse = p, h.rest_from = free_from;
      h.hit.begin = static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, window.begin()));
      h.end = record.response.size();
      if (b + 1 < blows.size()) {
        const Blow& next = blows[b + 1];
        const ForcePulse& first =
            next.doubled && next.second.peak < next.pulse.peak ? next.second : next.pulse;
        h.end = static_cast<std::size_t>(std::max<std::ptrdiff_t>(
            static_cast<std::ptrdiff_t>(p.peak) + 1, ForceWindow(first).begin()));
      }
      // The second half of what lies between two hits is rest, if there is any.
      free_from = (p.peak + h.end) / 2;
      h.hit.reason = judged_by_force(record, force, blows[b], step);
      all.hits.push_back(std::move(h));
    }
    if (blows.empty()) {
      JudgedHit none;
      none.hit.record = r, none.hit.t_s = time_of(0);
      none.hit.reason = "no hit: the force never stands out from its noise";
      all.hits.push_back(std::move(none));
    }
  }
}

void judge_peaks(std::vector<JudgedHit>& hits) {
  std::vector<double> peaks;
  for (const JudgedHit& h : hits)
    if (h.hit.reason.empty()) peaks.push_back(std::abs(h.hit.peak_N));
  const double usual = median(peaks);
  for (JudgedHit& h : hits)
    if (h.hit.reason.empty() && std::abs(h.hit.peak_N) < kLeastOfUsual * usual)
      h.hit.reason = "weak: its peak of " + printed(std::abs(h.hit.peak_N), 3) +
                     " N is less than a fifth of the usual " + printed(usual, 3) + " N";
}

/// Responses, and the noise that they all have.
void hear_responses(std::span<const ImpactRecord> records, JudgedHits& all) {
  std::vector<double> rests;
  for (JudgedHit& h : all.hits) {
    if (!h.hit.reason.empty()) continue;
    const ImpactRecord& record = records[h.hit.record];
    const std::span<const double> x(record.response);
    h.response =
        response_of(x.subspan(h.rest_from, h.hit.begin - std::min(h.hit.begin, h.rest_from)),
                    x.subspan(h.hit.begin, h.end - h.hit.begin), record.sample_rate_hz);
    // A tail that is quieter tells that the tool still moved before.
    const bool quiet = h.response.quiet <= 2 * h.response.tail;
    rests.push_back(quiet ? h.response.quiet : h.response.tail);
    all.rested = all.rested || quiet;
  }
  all.response_noise = median(rests);
  for (JudgedHit& h : all.hits) {
    if (!h.hit.reason.empty()) continue;
    const ImpactRecord& record = records[h.hit.record];
    h.hit.reason =
        judged_by_response(record, h, smallest_step(record.response), all.response_noise);
  }
}

/// The greatest length up to `most` that a transform likes: even, of the factors 2, 3 and 5.
std::size_t easy_length(std::size_t most) {
  for (std::size_t n = most - most % 2; n > 2; n -= 2) {
    std::size_t rest = n;
    for (const std::size_t factor : {2U, 3U, 5U})
      while (rest % factor == 0) rest /= factor;
    if (rest == 1) return n;
  }
  return 2;
}

void choose_length(JudgedHits& all, double rate, double length_s) {
  std::vector<double> there, lasting;
  for (const JudgedHit& h : all.hits) {
    if (!h.hit.reason.empty()) continue;
    there.push_back(static_cast<double>(h.end - h.hit.begin));
    lasting.push_back(static_cast<double>(std::max(h.response.lasts, h.response.block)));
  }
  if (there.empty()) return;
  double length = length_s * rate;
  if (!(length_s > 0)) {
    const double usual = kAlike * median(there);
    length = *std::max_element(there.begin(), there.end());
    for (const double n : there)
      if (n >= usual) length = std::min(length, n);
    length = std::min(length, kLongest * median(lasting));
  }
  const std::size_t n = easy_length(static_cast<std::size_t>(std::max(length, 16.0)));
  for (JudgedHit& h : all.hits) {
    if (!h.hit.reason.empty()) continue;
    const std::size_t own = std::min(n, h.end - h.hit.begin);
    const double left = h.response.left(own, all.rested ? all.response_noise : 0);
    const double most = own < n ? kLeastEnd : kMostLeft;
    h.hit.length = own;
    if (left > most)
      h.hit.reason = "too short: after " + milliseconds(static_cast<double>(own) / rate) +
                     (own < n ? ", when the next hit comes or the record ends," : "") +
                     " the response still is at " + percent(left) +
                     " of its highest; record longer";
    else
      all.length = n;
    h.hit.used = h.hit.reason.empty();
  }
}

}  // namespace

JudgedHits judge_hits(std::span<const ImpactRecord> records, double length_s) {
  JudgedHits all;
  find_hits(records, all);
  judge_peaks(all.hits);
  hear_responses(records, all);
  choose_length(all, records.front().sample_rate_hz, length_s);
  return all;
}

}  // namespace servosense::impact
