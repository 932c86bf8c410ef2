#include "transfer_spectra.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "dsp/fourier.hpp"
#include "student_quantile.hpp"
#include "transfer_lines.hpp"

namespace servosense::transfer {
namespace {

constexpr int kDraws = 400;          // percentiles of 2.5 % then lie on ten draws
constexpr double kNoNoise = 1e-15;   // least 1 - coherence: rounding
constexpr double kSureEnough = 100;  // signal over noise from which a phase is known

/// Degrees of freedom of the noise of `k` segments, which share 1 / 36 of its power with either
/// neighbour (Welch 1967).
double freedom_of(double k) { return 2 * std::max(k / (1 + (k - 1) / k / 18) - 1, 0.5); }

}  // namespace

std::size_t segments_in(std::span<const TransferRecord> records, std::size_t segment) {
  std::size_t count = 0;
  for (const TransferRecord& r : records)
    if (r.input.size() >= segment) count += (r.input.size() - segment) / (segment / 2) + 1;
  return count;
}

Spectra::Spectra(std::span<const TransferRecord> records, std::size_t segment, std::ptrdiff_t delay,
                 double input_noise2)
    : segment_(segment), delay_(delay), input_noise2_(input_noise2) {
  std::vector<CrossSums> sums;
  for (const TransferRecord& r : records) {
    OfRecord one{cross_spectrum(r.input, r.output, segment, delay), {}};
    one.excited = excited_lines(one.s.whole.input);
    sums.push_back(one.s.whole);
    records_.push_back(std::move(one));
  }
  lines_.resize(segment / 2 + 1);
  for (std::size_t m = 1; m < segment / 2; ++m) lines_[m] = merged(sums, m);
}

// Each record counts by the inverse of its variance; one that is not excited only where none is.
Line Spectra::merged(const std::vector<CrossSums>& sums, std::size_t m) const {
  const bool any = excited(m);
  Line line;
  double precision = 0, spread = 0, square = 0;
  for (std::size_t r = 0; r < records_.size(); ++r) {
    const CrossSums& w = sums[r];
    const auto k = static_cast<double>(w.segments);
    const double clean = k < 2 ? 0 : w.input[m] - k * input_noise2_ * records_[r].s.noise_gain;
    if (any != records_[r].excited[m] || !(clean > 0) || !(w.output[m] > 0)) continue;
    const double share = w.coherence(m);
    const double rest = w.output[m] * std::max(1 - share, kNoNoise);
    const double weight = (k - 1) * clean / (rest * records_[r].s.overlap[m]);
    const std::complex<double> h = w.cross[m] / clean;
    line.h += weight * h;
    line.coherence += weight * share;
    square += weight * std::norm(h);
    spread += weight * weight / freedom_of(k);
    precision += weight;
  }
  if (!(precision > 0)) return {};
  line.h /= precision;
  line.coherence /= precision;
  line.variance = 1 / (2 * precision * std::norm(line.h));
  line.freedom = precision * precision / spread;
  line.disagree = std::max(0.0, square - precision * std::norm(line.h));
  return line;
}

std::size_t Spectra::segments() const {
  std::size_t count = 0;
  for (const OfRecord& r : records_) count += r.s.whole.segments;
  return count;
}

std::size_t Spectra::most_segments() const {
  std::size_t most = 0;
  for (const OfRecord& r : records_) most = std::max(most, r.s.whole.segments);
  return most;
}

bool Spectra::excited(std::size_t m) const {
  return std::any_of(records_.begin(), records_.end(),
                     [m](const OfRecord& r) { return r.excited[m]; });
}

std::vector<double> Spectra::input() const {
  std::vector<double> power(lines_.size(), 0.0);
  for (const OfRecord& r : records_)
    for (std::size_t m = 0; m < power.size(); ++m) power[m] += r.s.whole.input[m];
  return power;
}

std::ptrdiff_t Spectra::late() const {
  std::vector<std::complex<double>> phases(segment_, 0.0), correlation;
  for (std::size_t m = 1; m < segment_ / 2; ++m) {
    const Line& line = lines_[m];
    if (!line.known() || !excited(m)) continue;
    const double sure = std::min(line.coherence / (1 - line.coherence), kSureEnough);
    phases[m] = sure * line.h / std::abs(line.h);
    phases[segment_ - m] = std::conj(phases[m]);
  }
  FourierTransform().inverse(phases, correlation);
  std::size_t at = 0;
  for (std::size_t i = 0; i < segment_; ++i)
    if (std::abs(correlation[i].real()) > std::abs(correlation[at].real())) at = i;
  const auto late = static_cast<std::ptrdiff_t>(at), n = static_cast<std::ptrdiff_t>(segment_);
  return late < n / 2 ? late : late - n;
}

std::vector<std::pair<double, double>> Spectra::drawn(double outside) const {
  std::vector<std::vector<float>> gains(lines_.size());
  std::mt19937_64 random(1);
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<CrossSums> sums;
    for (const OfRecord& r : records_) {
      CrossSums sum;
      for (std::size_t p = 0; p < r.s.parts.size(); ++p)
        sum += r.s.parts[random() % r.s.parts.size()];
      sums.push_back(std::move(sum));
    }
    for (std::size_t m = 1; m + 1 < lines_.size(); ++m)
      gains[m].push_back(
          sums.front().input.empty() ? 0 : static_cast<float>(std::abs(merged(sums, m).h)));
  }
  // Percentiles of few parts are too narrow, as a normal interval is beside Student's (Hesterberg
  // 2015).
  double parts = 0;
  for (const OfRecord& r : records_) parts += static_cast<double>(r.s.parts.size());
  const double wide = std::sqrt(parts / std::max(parts - 1, 1.0)) *
                      student_quantile(outside, std::max(parts - 1, 1.0)) /
                      normal_quantile(outside);
  std::vector<std::pair<double, double>> bands(lines_.size());
  const auto out = static_cast<std::size_t>(outside * kDraws);
  for (std::size_t m = 1; m + 1 < lines_.size(); ++m) {
    std::sort(gains[m].begin(), gains[m].end());
    const double gain = std::abs(lines_[m].h);
    bands[m] = {std::max(0.0, gain + wide * (static_cast<double>(gains[m][out]) - gain)),
                gain + wide * (static_cast<double>(gains[m][kDraws - 1 - out]) - gain)};
  }
  return bands;
}

}  // namespace servosense::transfer
