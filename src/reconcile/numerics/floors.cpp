#include "reconcile/numerics/floors.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/dsp/quantile.hpp"

namespace servosense::reconcile {
namespace {

constexpr std::size_t kLongest = 128;         // rows of a stretch without a break
constexpr std::size_t kShortestStretch = 32;  // five frequencies in the upper half of the band
constexpr std::size_t kFewestStretches = 4;   // stretches
constexpr double kMedianOfSquare = 0.6931;    // median of an exponential over its mean: ln 2

/// Mean square within the upper half of the band, spread over the whole of it. Medians over
/// frequencies and over stretches of `segment` rows, so neither lines nor bursts count. 0 where
/// there are too few of them.
double local_floor(const Problem& problem, const Column& residual, std::size_t segment) {
  const double row_hz = 1 / problem.row_period_s;
  const double corner = problem.noise_bandwidth_hz;
  const auto length = static_cast<double>(segment);
  const double bins = corner / row_hz * length;
  const auto from = static_cast<std::size_t>(0.5 * bins);
  const std::size_t to = std::min(segment / 2, static_cast<std::size_t>(bins) + 1);
  std::vector<double> shares;
  for (std::size_t at = 0; at + segment <= residual.size(); at += segment / 2) {
    bool good = true;
    for (std::size_t k = at; k < at + segment && good; ++k)
      good = problem.usable[k] && !problem.held_out[k];
    if (!good) continue;
    std::vector<double> powers;
    for (std::size_t bin = from; bin < to; ++bin) {
      double re = 0, im = 0;
      for (std::size_t k = 0; k < segment; ++k) {
        const double window =
            0.5 - 0.5 * std::cos(kTwoPi * (static_cast<double>(k) + 0.5) / length);
        const double phase = kTwoPi * static_cast<double>(bin * k % segment) / length;
        re += window * residual[at + k] * std::cos(phase);
        im += window * residual[at + k] * std::sin(phase);
      }
      // The Gaussian filter let this share of a white noise through.
      const double f = static_cast<double>(bin) * row_hz / length / corner;
      powers.push_back((re * re + im * im) / std::exp2(-f * f));
    }
    shares.push_back(median(std::move(powers)) / kMedianOfSquare);
  }
  if (shares.size() < kFewestStretches) return 0;
  // Per bin of a Hann window (mean square 3/8) to density, times the noise bandwidth of the filter
  // (integral of 2^-(f/fc)^2 over positive f: 1.0645 fc).
  const double density = median(shares) / (length * 0.375) * 2 / row_hz;
  return std::sqrt(density * 1.0645 * corner);
}

double lap_floor(const Problem& problem, const Column& residual) {
  if (problem.lap_rows == 0) return 0;
  double square = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i + problem.lap_rows < residual.size(); ++i) {
    const std::size_t later = i + problem.lap_rows;
    if (!problem.usable[i] || !problem.usable[later] || problem.held_out[later]) continue;
    const double d = residual[later] - residual[i];
    square += d * d;
    ++n;
  }
  return n > 100 ? std::sqrt(square / static_cast<double>(n) / 2) : 0;
}

}  // namespace

Floors floors_of(const Problem& problem, const Column& residual, const Criteria& criteria) {
  Floors f;
  f.lap = lap_floor(problem, residual);
  // A drive that often stops has short stretches only.
  for (std::size_t rows = kLongest; rows >= kShortestStretch && f.local <= 0; rows /= 2)
    f.local = local_floor(problem, residual, rows);
  // What is locked to time differs between laps: then the local floor is the credible one.
  if (f.lap > 0 && f.local > 0)
    f.used = f.lap > criteria.lap_floor_beyond_local * f.local ? f.local : f.lap;
  else
    f.used = std::max(f.lap, f.local);
  f.encoder = problem.encoder_floor;
  f.used = std::max(f.used, f.encoder);
  return f;
}

}  // namespace servosense::reconcile
