// Variance of a batch in two passes, first the mean, then the squares; summed in long double.
#pragma once

#include <cstddef>
#include <vector>

namespace oracle {

struct Batch {
  double mean = 0;
  double variance = 0;
};

/// Mean and variance with a weight for each sample.
inline Batch weighted_batch(const std::vector<double>& x, const std::vector<double>& weights) {
  using Wide = long double;
  Wide total = 0;
  Wide mean = 0;
  Wide variance = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    total += Wide(weights[i]);
    mean += Wide(weights[i]) * Wide(x[i]);
  }
  mean /= total;
  for (std::size_t i = 0; i < x.size(); ++i)
    variance += Wide(weights[i]) * (Wide(x[i]) - mean) * (Wide(x[i]) - mean);
  return {static_cast<double>(mean), static_cast<double>(variance / total)};
}

inline Batch batch(const std::vector<double>& x) {
  return weighted_batch(x, std::vector<double>(x.size(), 1.0));
}

}  // namespace oracle
