#include "servosense/identify/impact_pulse.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {
constexpr double kFoot = 0.1;              // of the peak: there a shoulder ends
constexpr double kFlat = 1.5, kEnd = 2.5;  // shoulders
}  // namespace

ForcePulse pulse_about(std::span<const double> force_N, std::size_t peak) {
  ForcePulse pulse{peak, force_N[peak], 0, 0};
  const double sign = pulse.peak_N < 0 ? -1 : 1;
  const double foot = kFoot * std::abs(pulse.peak_N);
  for (std::size_t i = peak; i-- > 0 && pulse.before == 0;)
    if (!(sign * force_N[i] > foot)) pulse.before = peak - i;
  for (std::size_t i = peak + 1; i < force_N.size() && pulse.after == 0; ++i)
    if (!(sign * force_N[i] > foot)) pulse.after = i - peak;
  return pulse;
}

ForceWindow::ForceWindow(const ForcePulse& pulse)
    : peak_(static_cast<double>(pulse.peak)),
      before_(static_cast<double>(pulse.before > 0 ? pulse.before : pulse.after)),
      after_(static_cast<double>(pulse.after > 0 ? pulse.after : pulse.before)) {}

double ForceWindow::operator()(std::ptrdiff_t sample) const {
  const double from_peak = static_cast<double>(sample) - peak_;
  const double shoulder = from_peak < 0 ? before_ : after_;
  const double away = std::abs(from_peak);
  if (away <= kFlat * shoulder) return 1;
  if (away >= kEnd * shoulder) return 0;
  return 0.5 * (std::cos(kPi * (away - kFlat * shoulder) / ((kEnd - kFlat) * shoulder)) + 1);
}

std::ptrdiff_t ForceWindow::begin() const {
  return static_cast<std::ptrdiff_t>(std::floor(peak_ - kEnd * before_));
}

std::ptrdiff_t ForceWindow::end() const {
  return static_cast<std::ptrdiff_t>(std::ceil(peak_ + kEnd * after_)) + 1;
}

double ForceWindow::power() const {
  double sum = 0;
  for (std::ptrdiff_t i = begin(); i < end(); ++i) sum += (*this)(i) * (*this)(i);
  return sum;
}

}  // namespace servosense
