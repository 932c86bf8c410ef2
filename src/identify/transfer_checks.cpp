#include "transfer_checks.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "servosense/dsp/cross_spectrum.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

bool keeps_sign(std::span<const double> x) {
  const auto [low, high] = std::minmax_element(x.begin(), x.end());
  return *low >= 0 || *high <= 0;
}

}  // namespace

bool is_rectified(std::span<const double> x) {
  if (x.size() < 5 || !keeps_sign(x)) return false;
  // Between two samples of a rough signal anything may have been.
  constexpr double kRough =
      0.35;  // mean square of a step over that of the signal; 0.5: white, even
  double square = 0, step = 0;
  for (std::size_t i = 1; i < x.size(); ++i) {
    square += x[i] * x[i];
    step += (x[i] - x[i - 1]) * (x[i] - x[i - 1]);
  }
  if (step > kRough * square) return false;
  const double sign = *std::max_element(x.begin(), x.end()) > 0 ? 1 : -1;
  constexpr std::size_t kLeastTurns = 3;
  constexpr double kStraight = 0.7;  // a parabola that touches zero reaches 0.35
  std::size_t turns = 0;
  for (std::size_t i = 1; i + 2 < x.size(); ++i) {
    const double down = sign * (x[i - 1] - x[i]), up = sign * (x[i + 2] - x[i + 1]);
    const double here = sign * x[i], next = sign * x[i + 1];
    // Both straight lines go on below zero, and folded back they meet.
    if (here < down && next < up && here + next > kStraight * std::max(down, up)) ++turns;
  }
  return turns >= kLeastTurns;
}

namespace transfer {
namespace {

double explained(std::span<const double> input, std::span<const double> output,
                 std::size_t segment) {
  const CrossSums s = cross_spectrum(input, output, segment).whole;
  double known = 0, all = 0;
  for (std::size_t m = 1; m + 1 < s.input.size(); ++m) {
    if (s.input[m] > 0) known += std::norm(s.cross[m]) / s.input[m];
    all += s.output[m];
  }
  return all > 0 ? known / all : 0;
}

/// Whether `maybe` has lost its sign: by its own course, or because it follows the magnitude of the
/// other rather than the other.
bool lost_sign(std::span<const double> maybe, std::span<const double> other, std::size_t segment) {
  if (is_rectified(maybe)) return true;
  if (!keeps_sign(maybe) || keeps_sign(other)) return false;
  std::vector<double> magnitude;
  for (const double x : other) magnitude.push_back(std::abs(x));
  const double by_magnitude = explained(magnitude, maybe, segment);
  constexpr double kMuch = 0.3, kMore = 1.5;  // chance explains 1 / segments of either
  return by_magnitude > kMuch && by_magnitude > kMore * explained(other, maybe, segment);
}

}  // namespace

Expected<Done> check_records(std::span<const TransferRecord> records, const TransferOptions& o) {
  if (records.empty()) return data_error("there is no record to take a transfer function from");
  const TransferRecord& first = records.front();
  for (const TransferRecord& r : records) {
    if (std::abs(r.sample_rate_hz / first.sample_rate_hz - 1) > 1e-3)
      return data_error(r.name + ": has " + printed(r.sample_rate_hz, 5) + " samples a second, " +
                        first.name + " has " + printed(first.sample_rate_hz, 5) +
                        "; merge records of one rate");
    for (const auto& [column, values] : {std::pair{&o.input, &r.input}, {&o.output, &r.output}}) {
      const auto [low, high] = std::minmax_element(values->begin(), values->end());
      if (values->empty() || *low == *high)
        return data_error(r.name + ": " + *column +
                          " does not vary, so nothing can be told of it; record a run in which it "
                          "does");
    }
  }
  return Done{};
}

Expected<Done> check_signs(std::span<const TransferRecord> records, const TransferOptions& o,
                           std::size_t segment) {
  for (const TransferRecord& r : records)
    for (const bool in : {true, false})
      if (lost_sign(in ? r.input : r.output, in ? r.output : r.input, segment))
        return data_error(r.name + ": " + (in ? o.input : o.output) +
                          " is an absolute value, its sign is lost and with it the transfer "
                          "function; record it with its sign");
  return Done{};
}

Expected<Done> check_excitation(const std::vector<LineRun>& runs, const std::vector<double>& power,
                                double line_hz, const TransferOptions& o) {
  if (runs.empty() || !std::all_of(runs.begin(), runs.end(),
                                   [&](const LineRun& run) { return is_single_line(run, power); }))
    return Done{};
  constexpr std::size_t kNamed = 8;
  std::string at;
  for (std::size_t i = 0; i < std::min(runs.size(), kNamed); ++i)
    at += (i == 0 ? "" : ", ") + printed(line_hz * middle_of(runs[i], power), 4);
  at += " Hz";
  if (runs.size() > kNamed)
    at += " and " + std::to_string(runs.size() - kNamed) + " more up to " +
          printed(line_hz * middle_of(runs.back(), power), 4) + " Hz";
  return data_error(
      o.input + " excites " + (runs.size() == 1 ? "a single line" : "a few lines") + ", at " + at +
      ", and nothing is known between and beyond; vary the speed, or take a cut that excites a "
      "whole band");
}

}  // namespace transfer
}  // namespace servosense
