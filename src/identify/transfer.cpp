#include "servosense/identify/transfer.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <optional>
#include <utility>

#include "regular_interval.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/io/text.hpp"
#include "student_quantile.hpp"
#include "transfer_checks.hpp"
#include "transfer_lines.hpp"
#include "transfer_spectra.hpp"

namespace servosense {
namespace {

using transfer::Line;
using transfer::LineRun;
using transfer::Spectra;

constexpr double kOutside = 0.025;           // of a band of 95 %, on either side
constexpr std::size_t kWantedSegments = 32;  // coherence then is known to some 0.03 at 0.9
constexpr std::size_t kWantedLines = 60;     // of the usable band
constexpr std::size_t kFewSegments = 8;      // below that bands are wide, and it is said
constexpr std::size_t kShortest = 16, kLongest = 16384;  // samples of a segment
constexpr std::size_t kMost = std::size_t{1} << 24;      // looked at, if asked for
constexpr std::size_t kMostTransformed = std::size_t{1} << 16;
constexpr double kWider = 1.25;             // resampled over closed: more is no chance
constexpr double kNoticed = 0.005;          // bias of a segment that is said
constexpr double kAllowedBias = 0.001;      // for the sake of more segments
constexpr double kConstant = 0.05;          // of a gain that is called constant
constexpr std::size_t kLowLines = 5;        // that tell the gain at the low end
constexpr std::size_t kConstantLines = 12;  // of the band in which it is
constexpr int kShifts = 4;                  // until the delay is found
constexpr std::size_t kBridged = 8;         // lines that a strong one hides, between excited ones

std::size_t first_segment(std::span<const TransferRecord> records, double segment_s) {
  std::size_t segment = kShortest;
  if (segment_s > 0) {
    const double wanted = segment_s * records.front().sample_rate_hz / std::sqrt(2.0);
    while (static_cast<double>(segment) < wanted && segment < kMost) segment *= 2;
    return segment;
  }
  for (segment = kLongest; segment > kShortest; segment /= 2)
    if (transfer::segments_in(records, segment) >= kWantedSegments) break;
  return segment;
}

/// The output shifted until it is no longer late.
Spectra shifted(std::span<const TransferRecord> records, std::size_t segment, double noise2) {
  Spectra spectra(records, segment, 0, noise2);
  for (int i = 0; i < kShifts; ++i) {
    const std::ptrdiff_t delay = spectra.delay() + spectra.late();
    if (delay == spectra.delay() || static_cast<std::size_t>(std::abs(delay)) >= segment) break;
    spectra = Spectra(records, segment, delay, noise2);
  }
  return spectra;
}

/// Lines above the usable coherence, between excited ones.
std::vector<LineRun> coherent_runs(const Spectra& spectra, std::size_t bridged) {
  std::vector<bool> coherent(spectra.lines().size(), false);
  for (std::size_t m = 0; m < coherent.size(); ++m)
    coherent[m] = spectra.excited(m) && spectra.lines()[m].coherence > transfer::kUsableCoherence;
  std::vector<LineRun> runs;
  for (const LineRun& run : transfer::runs_of(coherent)) {
    bool joined = !runs.empty() && run.from - runs.back().to <= bridged + 1;
    for (std::size_t m = joined ? runs.back().to : run.from; m < run.from; ++m)
      joined = joined && spectra.lines()[m].coherence > transfer::kUsableCoherence;
    if (joined)
      runs.back().to = run.to;
    else
      runs.push_back(run);
  }
  return runs;
}

std::optional<LineRun> usable_of(const std::vector<LineRun>& runs,
                                 const std::vector<double>& power) {
  for (const LineRun& run : runs)
    if (!transfer::is_single_line(run, power)) return run;
  return {};
}

/// How far the gain moves from segments to others half as long, over the lines of a band that both
/// have, as a share, chance taken off.
double moved(const Spectra& longer, const Spectra& shorter, const LineRun& run) {
  double square = 0, chance = 0, count = 0;
  for (std::size_t m = run.from + run.from % 2; m <= run.to; m += 2) {
    if (m < 2) continue;
    const Line &a = longer.lines()[m], &b = shorter.lines()[m / 2];
    if (!a.known() || !b.known()) continue;
    square += std::norm(b.h - a.h) / std::norm(a.h);
    chance += 2 * std::max(a.variance - b.variance, 0.0);
    ++count;
  }
  return count > 0 ? std::sqrt(std::max(0.0, square - chance) / count) : 0;
}

/// Median standard error of the gain in a band, as a share.
double noise_of(const Spectra& spectra, const LineRun& run) {
  std::vector<double> errors;
  for (std::size_t m = run.from; m <= run.to; ++m)
    errors.push_back(std::sqrt(spectra.lines()[m].variance));
  return median(errors);
}

/// Gain at the low end of a band.
double low_gain(const Spectra& spectra, const LineRun& band) {
  std::vector<double> first;
  for (std::size_t m = band.from; m <= std::min(band.from + kLowLines - 1, band.to); ++m)
    first.push_back(std::abs(spectra.lines()[m].h));
  return median(first);
}

/// The last line before one whose gain is for certain not that at the low end.
std::size_t constant_to(const Spectra& spectra, const LineRun& band) {
  const double low = low_gain(spectra, band);
  for (std::size_t m = band.from; m <= band.to; ++m) {
    const Line& line = spectra.lines()[m];
    const double gain = std::abs(line.h);
    const double unsure =
        student_quantile(kOutside, line.freedom) * gain * std::sqrt(line.variance);
    if (std::abs(gain - low) > kConstant * low + unsure) return m - 1;
  }
  return band.to;
}

/// Segments as short as the transfer function allows: the more there are, the less noise is left.
/// Their bias falls with the square of their length.
void shorten(std::span<const TransferRecord> records, double noise2, Spectra& spectra) {
  for (;;) {
    const auto usable = usable_of(coherent_runs(spectra, kBridged), spectra.input());
    if (!usable || usable->to - usable->from < 2 * kWantedLines ||
        spectra.segment() / 2 < kShortest)
      return;
    Spectra shorter(records, spectra.segment() / 2, spectra.delay(), noise2);
    const auto left = usable_of(coherent_runs(shorter, kBridged), shorter.input());
    const double bias = 4.0 / 3 * moved(spectra, shorter, *usable);
    if (!left || left->from > 2 || constant_to(shorter, *left) < left->from + kConstantLines ||
        2 * left->to + 4 < usable->to ||
        bias > std::max(kAllowedBias, noise_of(shorter, *left) / 2))
      return;
    spectra = std::move(shorter);
  }
}

/// How late the output is at the low end of the band, where the gain is constant.
void judge_course(TransferFunction& f, const Spectra& spectra, const LineRun& usable) {
  const std::vector<Line>& lines = spectra.lines();
  f.low_gain = low_gain(spectra, usable);
  const std::size_t to = constant_to(spectra, usable);
  f.constant_to_hz = static_cast<double>(to) / f.segment_s;
  // The phase as a straight line, each point by its variance.
  double w = 0, wx = 0, wy = 0, wxx = 0, wxy = 0, phase = 0;
  const std::size_t until = std::max(to, std::min(usable.from + kLowLines - 1, usable.to));
  for (std::size_t m = usable.from; m <= until; ++m) {
    if (m > usable.from) phase += std::arg(lines[m].h / lines[m - 1].h);
    const double x = static_cast<double>(m), weight = 1 / lines[m].variance;
    w += weight, wx += weight * x, wy += weight * phase;
    wxx += weight * x * x, wxy += weight * x * phase;
  }
  const double spread = w * wxx - wx * wx;
  f.late_s = f.shift_s;
  if (until > usable.from) f.late_s -= (w * wxy - wx * wy) / spread * f.segment_s / kTwoPi;
}

/// What the usable band as a whole tells.
void judge_band(TransferFunction& f, std::span<const TransferRecord> records,
                const Spectra& spectra, const LineRun& usable, double noise2,
                const std::vector<std::pair<double, double>>& drawn) {
  std::vector<double> ratio;
  double disagree = 0;
  for (std::size_t m = usable.from; m <= usable.to; ++m) {
    const Line& line = spectra.lines()[m];
    const double gain = std::abs(line.h);
    const double closed =
        2 * student_quantile(kOutside, line.freedom) * gain * std::sqrt(line.variance);
    if (closed > 1e-6 * gain) ratio.push_back((drawn[m].second - drawn[m].first) / closed);
    disagree += line.disagree;
    f.input_noise_share = std::max(f.input_noise_share, 1 - line.coherence);
  }
  judge_course(f, spectra, usable);
  if (spectra.segment() > kShortest)
    f.segment_bias =
        moved(spectra, Spectra(records, spectra.segment() / 2, spectra.delay(), noise2), usable) /
        3;
  if (f.segments >= kFewSegments) f.resampled_to_closed = median(ratio);
  if (records.size() > 1)
    f.records_disagree = std::sqrt(disagree / static_cast<double>(usable.to - usable.from + 1) /
                                   static_cast<double>(records.size() - 1));
  for (const double wide : {f.resampled_to_closed, f.records_disagree})
    if (wide > kWider) f.widened_by = std::max(f.widened_by, wide);
}

/// Samples for which a column holds each value; 0: every sample may bring a new one.
double held_samples(const std::vector<double>& x) {
  std::vector<std::size_t> apart;
  std::size_t since = 0;
  for (std::size_t i = 1; i < x.size(); ++i) {
    ++since;
    if (x[i] == x[i - 1]) continue;
    apart.push_back(since);
    since = 0;
  }
  return regular_interval(std::move(apart));
}

/// What is held tells nothing above half the rate of its new values.
void judge_holds(TransferFunction& f, std::span<const TransferRecord> records,
                 const TransferOptions& options) {
  for (const bool in : {true, false}) {
    double held = 0;
    for (const TransferRecord& r : records)
      held = std::max(held, held_samples(in ? r.input : r.output));
    if (!(held > 0)) continue;
    const double rate = records.front().sample_rate_hz / held;
    f.remarks.push_back((in ? options.input : options.output) + " has new values at " +
                        printed(rate, 3) +
                        " Hz only and holds them between: it is late by half of "
                        "that, and nothing is known above " +
                        printed(rate / 2, 3) + " Hz");
    f.usable_to_hz = std::min(f.usable_to_hz, rate / 2);
    f.constant_to_hz = std::min(f.constant_to_hz, rate / 2);
    if (f.usable_to_hz < f.usable_from_hz) f.usable_from_hz = f.usable_to_hz = 0;
  }
}

void remark(TransferFunction& f, const TransferOptions& options, double noise) {
  const bool usable = f.usable_to_hz > 0;
  if (!usable)
    f.remarks.push_back("the coherence is nowhere above 0.9: " + options.output + " is not " +
                        options.input + " alone, or noise hides it");
  if (f.segments < kFewSegments)
    f.remarks.push_back("there are " + std::to_string(f.segments) +
                        " segments only, so bands are wide and the coherence is too high by about "
                        "one over their number; record longer");
  if (f.resampled_to_closed > kWider)
    f.remarks.push_back("segments differ " + printed(f.resampled_to_closed, 2) +
                        " times as much as noise explains, and the bands are so much wider; the "
                        "cut or the load changes within the record");
  else if (usable && f.resampled_to_closed > 0 && f.resampled_to_closed < 1 / kWider)
    f.remarks.push_back(
        "segments drawn anew give bands " + printed(f.resampled_to_closed, 2) +
        " times as wide as those stated: there are few segments, and the wider ones "
        "are kept");
  if (f.records_disagree > kWider)
    f.remarks.push_back("the records disagree " + printed(f.records_disagree, 2) +
                        " times as much as their noise explains, and the bands are so much wider; "
                        "look at each alone");
  if (f.segment_bias > std::max(kNoticed, noise / 2))
    f.remarks.push_back("the transfer function changes by some " +
                        printed(100 * f.segment_bias, 2) + " % more when segments of " +
                        printed(f.segment_s, 3) +
                        " s are made longer; record longer or ask for longer ones");
  if (usable && options.input_noise == 0 && f.input_noise_share > kNoticed)
    f.remarks.push_back("if " + options.input +
                        " itself is noisy, the gain is low by its share of "
                        "noise, at most " +
                        printed(100 * f.input_noise_share, 2) +
                        " % in the usable band; --input-noise takes that off");
}

}  // namespace

Expected<TransferFunction> identify_transfer(std::span<const TransferRecord> records,
                                             const TransferOptions& options) {
  if (auto ok = transfer::check_records(records, options); !ok) return ok.error();
  const double rate = records.front().sample_rate_hz;
  const double noise2 = options.input_noise * options.input_noise;
  const std::size_t longest = first_segment(records, options.segment_s);
  const auto needs_two = [&](const std::string& why) {
    return data_error(records.front().name + ": there is " + why + " of " +
                      printed(static_cast<double>(longest) / rate, 3) +
                      " s, whose coherence is 1 whatever it holds; record longer or ask for "
                      "shorter segments");
  };
  if (transfer::segments_in(records, longest) < 2) return needs_two("one segment at most");
  if (longest > kMostTransformed)
    return data_error(records.front().name + ": a segment of " +
                      printed(static_cast<double>(longest) / rate, 3) + " s has more than " +
                      std::to_string(kMostTransformed) + " samples; ask for a shorter one");
  if (auto ok = transfer::check_signs(records, options, longest); !ok) return ok.error();
  Spectra spectra = shifted(records, longest, noise2);
  if (spectra.most_segments() < 2) return needs_two("no record with two segments");
  if (auto ok = transfer::check_excitation(coherent_runs(spectra, 0), spectra.input(),
                                           rate / static_cast<double>(longest), options);
      !ok)
    return ok.error();
  if (options.segment_s == 0) shorten(records, noise2, spectra);

  TransferFunction f;
  f.segments = spectra.segments();
  f.segment_s = static_cast<double>(spectra.segment()) / rate;
  f.shift_s = static_cast<double>(spectra.delay()) / rate;
  const std::vector<LineRun> runs = coherent_runs(spectra, kBridged);
  const std::optional<LineRun> usable = usable_of(runs, spectra.input());
  const auto drawn = spectra.drawn(kOutside);
  for (const LineRun& run : runs)
    f.coherent_bands_hz.emplace_back(static_cast<double>(run.from) / f.segment_s,
                                     static_cast<double>(run.to) / f.segment_s);
  if (usable) {
    f.usable_from_hz = static_cast<double>(usable->from) / f.segment_s;
    f.usable_to_hz = static_cast<double>(usable->to) / f.segment_s;
    judge_band(f, records, spectra, *usable, noise2, drawn);
  }
  std::vector<bool> covered(spectra.lines().size(), false);
  for (const LineRun& run : runs)
    std::fill_n(covered.begin() + static_cast<std::ptrdiff_t>(run.from), run.to - run.from + 1,
                true);
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t m = 1; m + 1 < spectra.lines().size(); ++m) {
    const Line& line = spectra.lines()[m];
    const double hz = static_cast<double>(m) / f.segment_s;
    const bool known = line.known() && (spectra.excited(m) || covered[m]);
    const double gain = known ? std::abs(line.h) : kUnknown;
    const double phase =
        known ? std::arg(line.h * std::polar(1.0, -kTwoPi * hz * f.shift_s)) : kUnknown;
    const double off =
        known ? student_quantile(kOutside, line.freedom) * f.widened_by * std::sqrt(line.variance)
              : kUnknown;
    const double turn = off < 1 ? std::asin(off) : kPi;
    f.frequency_hz.push_back(hz);
    f.gain.push_back(gain);
    f.gain_low.push_back(gain * std::max(0.0, 1 - off));
    f.gain_high.push_back(gain * (1 + off));
    f.phase_rad.push_back(phase);
    f.phase_low.push_back(phase - turn);
    f.phase_high.push_back(phase + turn);
    f.coherence.push_back(line.coherence);
    f.gain_resampled_low.push_back(known ? drawn[m].first : kUnknown);
    f.gain_resampled_high.push_back(known ? drawn[m].second : kUnknown);
  }
  judge_holds(f, records, options);
  remark(f, options, usable ? noise_of(spectra, *usable) : 0);
  return f;
}

}  // namespace servosense
