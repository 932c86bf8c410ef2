#include "stable_speeds_ramps.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {

constexpr double kSlowest = 0.2;   // of the highest speed: below it the spindle starts or stops
constexpr double kRamp = 0.1;      // of its highest speed: a ramp spans at least this, and one that
                                   // has ended goes back as far; less is what a weak loop lets the
                                   // cut do to the speed
constexpr double kStandsOut = 10;  // power in the cut over that of air; means of eight revolutions
                                   // of noise stay within a factor of three of each other
constexpr double kLoud = 0.01;     // of the power in the cut: nothing below it cuts
constexpr std::size_t kRevolutions = 8;  // over which the power is a mean

struct Revolution {
  std::size_t first = 0, last = 0;  // samples
  double speed_rad_s = 0;
  double mean_Nm = 0;
  double power_Nm2 = 0;  // about a straight line
};

/// Mean and mean square about the straight line.
void measure(const std::vector<double>& x, Revolution& r) {
  const auto n = static_cast<double>(r.last - r.first);
  double sum = 0, slope = 0, squares = 0;
  for (std::size_t i = r.first; i < r.last; ++i) sum += x[i];
  r.mean_Nm = sum / n;
  for (std::size_t i = r.first; i < r.last; ++i) {
    const double t = (static_cast<double>(i - r.first) + 0.5) / n - 0.5;
    slope += 12 * t * x[i] / n;
    squares += (x[i] - r.mean_Nm) * (x[i] - r.mean_Nm) / n;
  }
  r.power_Nm2 = std::max(0.0, squares - slope * slope / 12);
}

/// Whole revolutions of a spindle that is up to speed.
std::vector<Revolution> revolutions_of(const CuttingTorqueTrace& record, int teeth) {
  const std::vector<double>& speed = record.spindle_speed_rad_s;
  std::vector<double> size(speed.size());
  for (std::size_t i = 0; i < speed.size(); ++i) size[i] = std::abs(speed[i]);
  const double top = percentile(size, 0.99);
  if (!(top > 0)) return {};
  // The teeth are seen, the noise above them is not.
  const std::vector<double> torque =
      low_passed(record.torque_Nm, record.sample_rate_hz, teeth * top / kTwoPi);
  std::vector<Revolution> all;
  Revolution now;
  double angle = 0;
  for (std::size_t i = 0; i < size.size(); ++i) {
    if (size[i] < kSlowest * top) {
      angle = 0;
      now.first = i + 1;
      continue;
    }
    angle += size[i] / record.sample_rate_hz;
    if (angle < kTwoPi) continue;
    now.last = i + 1;
    now.speed_rad_s = angle * record.sample_rate_hz / static_cast<double>(now.last - now.first);
    if (now.last - now.first > 3) {
      measure(torque, now);
      all.push_back(now);
    }
    angle = 0;
    now.first = i + 1;
  }
  return all;
}

/// Pieces of the record in which the speed only rises or only falls, as revolutions, the second not
/// in the piece.
std::vector<std::pair<std::size_t, std::size_t>> monotone(const std::vector<Revolution>& all) {
  double top = 0;
  for (const Revolution& r : all) top = std::max(top, r.speed_rad_s);
  std::vector<std::pair<std::size_t, std::size_t>> pieces;
  std::size_t begin = 0, high = 0, low = 0;
  int direction = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double v = all[i].speed_rad_s;
    const bool apart = i > 0 && all[i].first != all[i - 1].last;  // it stood still
    if (v > all[high].speed_rad_s) high = i;
    if (v < all[low].speed_rad_s) low = i;
    const bool down = v < all[high].speed_rad_s - kRamp * top;
    const bool up = v > all[low].speed_rad_s + kRamp * top;
    if (apart) {
      pieces.emplace_back(begin, i);
      begin = high = low = i;
      direction = 0;
    } else if (down && direction >= 0) {
      if (direction > 0) pieces.emplace_back(begin, high + 1), begin = high;
      direction = -1;
      low = i;
    } else if (up && direction <= 0) {
      if (direction < 0) pieces.emplace_back(begin, low + 1), begin = low;
      direction = 1;
      high = i;
    }
    if (direction > 0) low = high;
    if (direction < 0) high = low;
  }
  if (begin < all.size()) pieces.emplace_back(begin, all.size());
  return pieces;
}

}  // namespace

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto at = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

std::vector<double> low_passed(const std::vector<double>& x, double sample_rate_hz,
                               double cutoff_hz) {
  // exp(-(2 pi f sigma)^2) of the power is one half at the cutoff.
  const double sigma = std::sqrt(std::log(2.0)) / kTwoPi * sample_rate_hz / cutoff_hz;
  const auto reach = static_cast<std::size_t>(std::ceil(4 * sigma));
  std::vector<double> weight(reach + 1);
  double sum = 0;
  for (std::size_t i = 0; i <= reach; ++i) {
    const double t = static_cast<double>(i) / sigma;
    weight[i] = std::exp(-0.5 * t * t);
    sum += (i == 0 ? 1 : 2) * weight[i];
  }
  for (double& w : weight) w /= sum;
  std::vector<double> y(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    y[i] = weight[0] * x[i];
    for (std::size_t k = 1; k <= reach; ++k)
      y[i] += weight[k] * (x[i > k ? i - k : 0] + x[std::min(i + k, x.size() - 1)]);
  }
  return y;
}

double noise_in_air(const std::vector<double>& torque, const std::vector<RampSpan>& air) {
  std::vector<double> noise;
  for (std::size_t i = 1; i < air.size(); ++i) {
    if (air[i].first != air[i - 1].last) continue;
    std::vector<double> change;
    for (std::size_t k = 0; air[i - 1].first + k < air[i].first && air[i].first + k < air[i].last;
         ++k)
      change.push_back(torque[air[i].first + k] - torque[air[i - 1].first + k]);
    Revolution both;
    both.last = change.size();
    if (change.size() < 4) continue;
    measure(change, both);
    noise.push_back(both.power_Nm2 / 2);
  }
  return percentile(noise, 0.5);
}

RampsOfRecord ramps_in_cut(const CuttingTorqueTrace& record, int teeth) {
  RampsOfRecord result;
  std::vector<Revolution> all = revolutions_of(record, teeth);
  const std::size_t fewest = kFewestTeeth / static_cast<std::size_t>(teeth) + 1;
  if (all.size() < fewest) return result;
  std::vector<double> power;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const std::size_t from = i > kRevolutions / 2 ? i - kRevolutions / 2 : 0;
    const std::size_t to = std::min(all.size(), i + kRevolutions / 2);
    double sum = 0;
    for (std::size_t k = from; k < to; ++k) sum += all[k].power_Nm2;
    power.push_back(sum / static_cast<double>(to - from));
  }
  // The quietest and the loudest revolutions, as many as the shortest cut has.
  std::vector<double> sorted = power;
  std::sort(sorted.begin(), sorted.end());
  const double quiet = sorted[std::min(fewest, sorted.size()) / 2];
  const double loud = sorted[sorted.size() - fewest];
  result.cut_stands_out = loud > kStandsOut * quiet;
  const double limit = result.cut_stands_out ? std::max(std::sqrt(quiet * loud), kLoud * loud) : 0;

  std::vector<double> in_cut, in_air;
  for (std::size_t i = 0; i < all.size(); ++i)
    (power[i] >= limit ? in_cut : in_air).push_back(all[i].mean_Nm);
  if (result.cut_stands_out) {
    result.cutting_torque_Nm = std::abs(percentile(in_cut, 0.5) - percentile(in_air, 0.5));
    for (std::size_t i = 0; i < all.size(); ++i)
      if (power[i] < limit) result.air.push_back({all[i].first, all[i].last});
  }

  for (const auto& [begin, end] : monotone(all)) {
    // From the first to the last revolution that cuts: in a pocket between them it may be as quiet
    // as in the air.
    std::size_t first = begin, last = end;
    while (first < last && power[first] < limit) ++first;
    while (last > first && power[last - 1] < limit) --last;
    double fastest = 0, slowest = std::numeric_limits<double>::infinity();
    for (std::size_t i = first; i < last; ++i) {
      fastest = std::max(fastest, all[i].speed_rad_s);
      slowest = std::min(slowest, all[i].speed_rad_s);
    }
    if (last - first >= fewest && fastest - slowest > kRamp * fastest)
      result.ramps.push_back({all[first].first, all[last - 1].last});
  }
  return result;
}

}  // namespace servosense
