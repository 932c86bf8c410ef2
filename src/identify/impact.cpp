#include "servosense/identify/impact.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <map>

#include "dsp/fourier.hpp"
#include "impact_hits.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/cross_spectrum.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/identify/hammer_offset.hpp"
#include "servosense/io/text.hpp"
#include "transfer_lines.hpp"

namespace servosense {
namespace {

using impact::JudgedHit;
using impact::JudgedHits;
using transfer::LineRun;

constexpr double kLeft = 0.001;          // of the response at its end: less is no error to speak of
constexpr double kForceDown = 1e-4;      // of its highest power: 40 dB
constexpr double kForceNoise = 4;        // times its noise: the tip hardly excites what lies below
constexpr double kSure = 1.0 / 3;        // standard error over the receptance of a usable line
constexpr double kWider = 1.25;          // scatter over noise: more is no chance
constexpr std::size_t kFewestLines = 8;  // of a band
constexpr std::size_t kSamplesLeast = 64;
constexpr double kRates = 1e-3;     // by which the rates of records may differ
constexpr double kWanders = 3;      // times the rms of a zero that moves, at its worst
constexpr double kTold = 0.001;     // of the receptance: less scatter is not spoken of
constexpr double kStandsOut = 2;    // a resonance over the valleys on both sides
constexpr double kSoftened = 0.02;  // of the highest: smaller resonances are not told of

struct Spectra {
  CrossSums sums;
  double force_noise = 0, response_noise = 0;  ///< what noise puts into |F|^2 and |X|^2 of a hit
  double cut_short = 0;  ///< what the end of the record takes from |X|^2 far from a resonance
  double wander = 0;     ///< what a zero that moves puts into |X|^2 at 1 rad a sample
};

/// Force and response of the hits that are used, under their windows.
Spectra spectra_of(const JudgedHits& all, double rate, double decay_per_s) {
  const std::size_t n = all.length, lines = n / 2 + 1;
  Spectra s{{0, std::vector(lines, 0.0), std::vector(lines, 0.0),
             std::vector(lines, std::complex<double>{})}};
  std::vector<double> fall(n);
  for (std::size_t i = 0; i < n; ++i)
    fall[i] = std::exp(-decay_per_s * static_cast<double>(i) / rate);
  FourierTransform fft;
  std::vector<std::complex<double>> of_force, of_response;
  double used = 0;
  for (const JudgedHit& h : all.hits) {
    if (!h.hit.used) continue;
    const std::vector<double>& measured = all.force[h.hit.record].force_N;
    const double noise = all.force[h.hit.record].noise_N;
    const ForceWindow window(h.pulse);
    std::vector<double> force(n, 0.0), response(n, 0.0);
    for (std::size_t i = 0; i < h.hit.length; ++i) {
      const double w = fall[i] * window(static_cast<std::ptrdiff_t>(h.hit.begin + i));
      force[i] = w * measured[h.hit.begin + i];
      response[i] = fall[i] * h.response.x[i];
      s.force_noise += w * w * noise * noise;
      s.response_noise += fall[i] * fall[i] * all.response_noise * all.response_noise;
    }
    s.cut_short += std::pow(
        fall.back() * h.response.beyond(h.hit.length, all.rested ? all.response_noise : 0), 2);
    s.wander += std::pow(kWanders * h.response.wander, 2);
    fft.forward(force, of_force);
    fft.forward(response, of_response);
    s.sums.add(of_force, of_response);
    ++used;
  }
  s.force_noise /= used;
  s.response_noise /= used;
  s.cut_short /= used;
  s.wander /= used;
  return s;
}

/// Estimate of a line: its value, the variance of that as noise makes it, and its coherence.
struct Line {
  std::complex<double> h;
  double variance = 0, coherence = 0;
};

Line line_of(const Spectra& s, std::size_t m, FrfEstimator estimator) {
  const auto hits = static_cast<double>(s.sums.segments);
  const double sff = s.sums.input[m] / hits, sxx = s.sums.output[m] / hits;
  Line line;
  line.coherence = s.sums.coherence(m);
  if (s.sums.segments == 1)
    line.coherence = sff > 0 && sxx > 0 ? std::max(0.0, 1 - s.response_noise / sxx) *
                                              std::max(0.0, 1 - s.force_noise / sff)
                                        : 0;
  const double c = std::max(line.coherence, 1e-6);
  const std::complex<double> h1 = s.sums.h1(m), h2 = s.sums.h2(m);
  // Dunwoody 2010, eq. 4.39 and 4.41.
  const double v1 = (s.response_noise + std::norm(h1) * s.force_noise / c) / (hits * sff);
  const double v2 =
      std::norm(h2) / (hits * sxx) * (s.response_noise / c + std::norm(h2) * s.force_noise);
  line.h = estimator == FrfEstimator::h1 ? h1 : estimator == FrfEstimator::h2 ? h2 : s.sums.hv(m);
  line.variance = estimator == FrfEstimator::h1   ? v1
                  : estimator == FrfEstimator::h2 ? v2
                                                  : 0.5 * (v1 + v2);
  return line;
}

/// How much more hits scatter than their noise explains, as a factor on the standard error. The
/// scatter of a line is |H|^2 (1 - C) / (C (M - 1)), of 2 (M - 1) degrees of freedom.
double scatter_of(const Spectra& s, const std::vector<Line>& lines,
                  const std::vector<bool>& excited) {
  if (s.sums.segments < 2) return 1;
  const double more = static_cast<double>(s.sums.segments - 1);
  std::vector<double> ratio;
  for (std::size_t m = 1; m < lines.size(); ++m)
    if (excited[m] && lines[m].variance > 0 && lines[m].coherence > 0.5)
      ratio.push_back(std::norm(lines[m].h) * (1 - lines[m].coherence) /
                      (lines[m].coherence * more * lines[m].variance));
  // Median over mean of chi squared (Wilson and Hilferty 1931).
  const double chi = std::pow(1 - 1 / (9 * more), 3);
  return ratio.empty() ? 1 : std::sqrt(std::max(1.0, median(ratio) / chi));
}

/// Runs of at least eight lines in which most hold, so that a few are bridged by what lies about
/// them: a valley between resonances is no end.
std::vector<LineRun> bridged_runs(const std::vector<bool>& holds) {
  std::vector<std::size_t> sum(holds.size() + 1, 0);
  for (std::size_t m = 0; m < holds.size(); ++m) sum[m + 1] = sum[m] + (holds[m] ? 1U : 0U);
  std::vector<bool> most(holds.size());
  for (std::size_t m = 0; m < holds.size(); ++m) {
    const std::size_t reach = 4 + m / 20;
    const std::size_t low = m > reach ? m - reach : 0, high = std::min(holds.size(), m + reach + 1);
    most[m] = 2 * (sum[high] - sum[low]) > high - low;
  }
  std::vector<LineRun> runs = transfer::runs_of(most);
  for (LineRun& run : runs) {
    while (run.from < run.to && !holds[run.from]) ++run.from;
    while (run.from < run.to && !holds[run.to]) --run.to;
  }
  std::erase_if(runs, [](const LineRun& r) { return r.to < r.from + kFewestLines; });
  return runs;
}

/// Lines of the resonances of a band: higher than valleys on both sides by a factor.
std::vector<std::size_t> resonances(const std::vector<std::complex<double>>& g, std::size_t from,
                                    std::size_t to) {
  std::vector<std::size_t> found;
  double valley = std::abs(g[from]), top = valley;
  std::size_t at = from;
  bool rising = false;
  for (std::size_t i = from; i <= to; ++i) {
    const double size = std::abs(g[i]);
    if (rising && size > top) top = size, at = i;
    if (rising && size < top / kStandsOut) {
      found.push_back(at);
      rising = false;
      valley = size;
    }
    if (!rising) {
      valley = std::min(valley, size);
      if (size > kStandsOut * valley) rising = true, top = size, at = i;
    }
  }
  return found;
}

/// The reasons of hits that are not used, each with its number.
std::string counted_reasons(const std::vector<ImpactHit>& hits) {
  std::map<std::string, std::size_t> counts;
  for (const ImpactHit& h : hits)
    if (!h.used) ++counts[h.reason.substr(0, h.reason.find(':'))];
  std::string text;
  for (const auto& [kind, count] : counts)
    text += (text.empty() ? "" : ", ") + kind + " (" + std::to_string(count) + ")";
  return text;
}

Expected<Done> check_records(std::span<const ImpactRecord> records) {
  if (records.empty()) return data_error("there is no record of a hit; give at least one trace");
  const double rate = records.front().sample_rate_hz;
  for (const ImpactRecord& r : records) {
    if (!(r.sample_rate_hz > 0) || std::abs(r.sample_rate_hz - rate) > kRates * rate)
      return data_error(r.name + ": its rate is " + printed(r.sample_rate_hz, 6) + " Hz, that of " +
                        records.front().name + " is " + printed(rate, 6) +
                        " Hz; record all hits at one rate");
    if (r.force_N.size() < kSamplesLeast || r.force_N.size() != r.response.size())
      return data_error(r.name + ": there are " + std::to_string(r.force_N.size()) +
                        " samples only; record longer");
  }
  return Done{};
}

/// Rate of the window that all hits need.
double decay_needed(const JudgedHits& all, double rate) {
  double left = 0;
  for (const JudgedHit& h : all.hits)
    if (h.hit.used)
      left = std::max(left, h.response.left(h.hit.length, all.rested ? all.response_noise : 0));
  return left > kLeft ? std::log(left / kLeft) * rate / static_cast<double>(all.length) : 0;
}

/// `row`: where a line stands in the response.
void judge_band(ImpactResult& f, const std::vector<bool>& sure,
                const std::vector<std::size_t>& row) {
  const std::vector<LineRun> runs = bridged_runs(sure);
  if (runs.empty()) return;
  const std::vector<double>& hz = f.response.frequency_hz;
  const auto& g = f.response.receptance_m_per_N;
  const std::size_t from = row[runs.front().from], to = row[runs.back().to];
  f.usable_from_hz = hz[from], f.usable_to_hz = hz[to];
  std::string gaps;
  for (std::size_t r = 1; r < runs.size(); ++r)
    gaps += (r > 1 ? ", " : "") + printed(hz[row[runs[r - 1].to]], 4) + " to " +
            printed(hz[row[runs[r].from]], 4) + " Hz";
  if (!gaps.empty())
    f.remarks.push_back("noise, or a force that is too weak, hides the receptance from " + gaps +
                        "; look at the standard error there");
  std::vector<double> c, error;
  double against = 0, with = 0;
  std::vector<bool> counts(hz.size(), false);
  for (const LineRun& run : runs)
    for (std::size_t m = run.from; m <= run.to; ++m) {
      if (!sure[m]) continue;
      const std::size_t i = row[m];
      counts[i] = true;
      c.push_back(f.response.coherence[i]);
      error.push_back(f.response.standard_error_m_per_N[i] / std::abs(g[i]));
      (g[i].imag() > 0 ? against : with) += std::abs(g[i].imag()) * std::abs(g[i]);
    }
  f.coherence = median(c);
  f.relative_error = median(error);
  std::vector<std::size_t> peaks = resonances(g, from, to);
  std::erase_if(peaks, [&](std::size_t p) { return !counts[p]; });
  for (const std::size_t p : peaks)
    if (std::abs(g[p]) > f.peak_m_per_N) f.peak_m_per_N = std::abs(g[p]), f.peak_hz = hz[p];
  for (const std::size_t p : peaks)
    if (f.offset_factor > 1 && hz[p] < f.peak_hz && std::abs(g[p]) > kSoftened * f.peak_m_per_N)
      f.softened_hz.push_back(hz[p]);
  if (against > with)
    f.remarks.push_back(
        "the response has the sign of a tool that moves against the hammer: if both are at one "
        "point, one sensor counts the other way round; --reverse turns the response");
}

void remark(ImpactResult& f, const ImpactOptions& options) {
  const double a = f.response.exponential_window_per_s;
  if (a > 0)
    f.remarks.push_back(
        (options.exponential_window_per_s ? ""
                                          : "the response has not died away at the end of its "
                                            "record: ") +
        std::string("an exponential window of ") + printed(a, 3) +
        " per s lies over the hits, which adds " + printed(a / kTwoPi, 3) +
        " Hz over the natural frequency to every damping ratio; 'identify modes' takes it off "
        "again");
  if (f.averages == 1)
    f.remarks.push_back(
        "there is one hit: its coherence would be 1 whatever it holds, so the column holds what "
        "its "
        "noise lets expect; hit five times");
  if (f.widened_by > 1 && f.relative_error > kTold)
    f.remarks.push_back("the hits differ " + printed(f.widened_by, 2) +
                        " times as much as their noise explains, and the standard errors are so "
                        "much wider; hit the same point, in the same direction");
  if (f.offset_factor > 1) {
    std::string where;
    for (const double hz : f.softened_hz)
      where += (where.empty() ? "" : ", ") + printed(hz, 4) + " Hz";
    f.remarks.push_back("the receptance is multiplied by " + printed(f.offset_factor, 5) +
                        " for the hammer's offset, as if the tool bends and all else is rigid: "
                        "modes of spindle and "
                        "holder come out too soft by up to that" +
                        (where.empty() ? "" : ", here at " + where));
  }
}

}  // namespace

Expected<ImpactResult> identify_impact(std::span<const ImpactRecord> records,
                                       const ImpactOptions& options) {
  ImpactResult f;
  if (options.offset_m != 0 || options.stick_out_m != 0) {
    const auto factor = hammer_offset_factor(options.offset_m, options.stick_out_m);
    if (!factor) return factor.error();
    f.offset_factor = *factor;
  }
  if (auto ok = check_records(records); !ok) return ok.error();
  const double rate = records.front().sample_rate_hz;
  const JudgedHits all = impact::judge_hits(records, options.length_s);
  for (const JudgedHit& h : all.hits) {
    f.hits.push_back(h.hit);
    f.averages += h.hit.used ? 1U : 0U;
  }
  if (f.averages == 0) {
    const ImpactHit& first = f.hits.front();
    return data_error(records[first.record].name + ": none of " + std::to_string(f.hits.size()) +
                      (f.hits.size() == 1 ? " hit" : " hits") +
                      " can be used: " + counted_reasons(f.hits) + "; the one at " +
                      printed(first.t_s, 6) + " s: " + first.reason);
  }
  const double decay = options.exponential_window_per_s.value_or(decay_needed(all, rate));
  const Spectra s = spectra_of(all, rate, decay);
  f.sample_rate_hz = rate;
  f.length_s = static_cast<double>(all.length) / rate;
  f.response.exponential_window_per_s = decay;
  f.response_noise = all.response_noise;
  for (const JudgedHit& h : all.hits) {
    if (!h.hit.used) continue;
    f.force_noise_N += all.force[h.hit.record].noise_N / static_cast<double>(f.averages);
    f.window_noise_gain +=
        std::sqrt(ForceWindow(h.pulse).power() / static_cast<double>(all.length)) /
        static_cast<double>(f.averages);
  }

  const double highest = *std::max_element(s.sums.input.begin() + 1, s.sums.input.end());
  const double least =
      std::max(kForceDown * highest, kForceNoise * s.force_noise * static_cast<double>(f.averages));
  std::vector<bool> sure(all.length / 2, false);
  for (std::size_t m = 1; m < sure.size(); ++m) sure[m] = s.sums.input[m] > least;
  const std::vector<LineRun> excited = bridged_runs(sure);
  const std::size_t end = excited.empty() ? 1 : excited.back().to + 1;
  sure.resize(end);
  std::vector<Line> lines(end);
  for (std::size_t m = 1; m < end; ++m) lines[m] = line_of(s, m, options.estimator);
  if (const double scatter = scatter_of(s, lines, sure); scatter > kWider) f.widened_by = scatter;
  std::vector<std::size_t> row(end, 0);
  for (std::size_t m = 1; m < end; ++m) {
    if (!sure[m]) continue;
    row[m] = f.response.frequency_hz.size();
    const double hz = static_cast<double>(m) / f.length_s;
    std::complex<double> scale = (options.reversed ? -1 : 1) * f.offset_factor;
    const std::complex<double> laplace(decay, kTwoPi * hz);
    for (int k = 0; k < static_cast<int>(options.response); ++k) scale /= laplace;
    // Noise; what is cut off, and a zero that moves, are alike in every hit.
    const double turn = kTwoPi * hz / rate;
    const double alike = (s.cut_short + s.wander / (turn * turn)) *
                         static_cast<double>(f.averages) / s.sums.input[m];
    const double error = std::hypot(f.widened_by * std::sqrt(lines[m].variance), std::sqrt(alike));
    sure[m] = error < kSure * std::abs(lines[m].h);
    f.response.frequency_hz.push_back(hz);
    f.response.receptance_m_per_N.push_back(lines[m].h * scale);
    f.response.coherence.push_back(lines[m].coherence);
    f.response.standard_error_m_per_N.push_back(error * std::abs(scale));
    f.force_Ns.push_back(std::sqrt(s.sums.input[m] / static_cast<double>(f.averages)) / rate);
  }
  judge_band(f, sure, row);
  if (!(f.usable_to_hz > 0))
    return data_error(records.front().name +
                      ": noise hides the response at all frequencies that the hammer excites; hit "
                      "harder, more often, or with a sensor of a narrower range");
  remark(f, options);
  return f;
}

}  // namespace servosense
