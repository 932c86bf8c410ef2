// Lowest value of a function of one variable, by golden section. Offline.
#pragma once

namespace servosense {

/// Middle of the interval in which `f` is lowest, narrowed from [low, high] until
/// `close(low, high)`. A function with several dips gives one of them.
template <typename Function, typename Close>
double lowest_between(const Function& f, double low, double high, const Close& close) {
  constexpr double kGolden = 0.6180339887498949;
  double left = high - kGolden * (high - low), right = low + kGolden * (high - low);
  double at_left = f(left), at_right = f(right);
  while (!close(low, high)) {
    if (at_left < at_right) {
      high = right;
      right = left;
      at_right = at_left;
      left = high - kGolden * (high - low);
      at_left = f(left);
    } else {
      low = left;
      left = right;
      at_left = at_right;
      right = low + kGolden * (high - low);
      at_right = f(right);
    }
  }
  return 0.5 * (low + high);
}

}  // namespace servosense
