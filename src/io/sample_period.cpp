#include "servosense/io/sample_period.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace servosense {

double sample_period(std::span<const double> times) {
  if (times.size() < 2) return 0;
  double period = 0;
  std::vector<double> periods;
  for (std::size_t apart = 1; apart <= times.size() / 2 || apart == 1; apart *= 2) {
    periods.clear();
    for (std::size_t i = 0; i + apart < times.size(); ++i) {
      const double step = times[i + apart] - times[i];
      periods.push_back(period > 0 ? step / std::max(1.0, std::round(step / period)) : step);
    }
    const auto middle = periods.begin() + static_cast<std::ptrdiff_t>(periods.size() / 2);
    std::nth_element(periods.begin(), middle, periods.end());
    period = *middle;
  }
  return period;
}

}  // namespace servosense
