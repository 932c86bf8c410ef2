#include "reconcile/numerics/maps.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "reconcile/numerics/least_squares.hpp"

namespace servosense::reconcile {
namespace {

constexpr unsigned kPermutations = 99;

struct Binned {
  std::vector<std::size_t> bin;  // of each fitted row
  std::vector<double> factor;
  std::size_t bins = 0;
  Column at;
  Column weight[2];  // of the bins in even blocks and in odd ones
};

Binned binned(const Coordinate& c, const FitRows& rows) {
  Binned b;
  b.bins = c.bins;
  b.at.assign(c.bins, 0);
  std::vector<double> values;
  values.reserve(rows.rows.size());
  for (const std::size_t r : rows.rows) {
    const double v = c.values[r];
    values.push_back(c.period > 0 ? v - c.period * std::floor(v / c.period) : v);
    b.factor.push_back(c.factor.empty() ? 1 : c.factor[r]);
  }
  // As many rows in each bin: slow and fast, near and far, count alike.
  std::vector<double> sorted = values;
  std::sort(sorted.begin(), sorted.end());
  std::vector<double> edges;
  for (unsigned k = 1; k < c.bins; ++k)
    edges.push_back(c.period > 0 ? c.period * k / c.bins : sorted[k * sorted.size() / c.bins]);
  std::vector<double> count(c.bins, 0);
  for (const double v : values) {
    const auto bin =
        static_cast<std::size_t>(std::upper_bound(edges.begin(), edges.end(), v) - edges.begin());
    b.bin.push_back(bin);
    b.at[bin] += v;
    ++count[bin];
  }
  for (std::size_t k = 0; k < c.bins; ++k) b.at[k] /= std::max(1.0, count[k]);
  for (Column& weight : b.weight) weight.assign(b.bins, 0);
  for (std::size_t block = 0; block < rows.blocks(); ++block)
    for (std::size_t i = rows.first[block]; i < rows.first[block + 1]; ++i)
      b.weight[block % 2][b.bin[i]] += b.factor[i] * b.factor[i];
  return b;
}

/// Share of the variance explained on blocks left out: even blocks predict odd ones and back.
double share(const Binned& b, const FitRows& rows, const std::vector<double>& r) {
  double left = 0, all = 0;
  Column mean[2];
  for (Column& half : mean) half.assign(b.bins, 0);
  for (std::size_t block = 0; block < rows.blocks(); ++block)
    for (std::size_t i = rows.first[block]; i < rows.first[block + 1]; ++i)
      mean[block % 2][b.bin[i]] += b.factor[i] * r[i];
  for (std::size_t half = 0; half < 2; ++half)
    for (std::size_t k = 0; k < b.bins; ++k)
      mean[half][k] = b.weight[half][k] > 0 ? mean[half][k] / b.weight[half][k] : 0;
  for (std::size_t block = 0; block < rows.blocks(); ++block)
    for (std::size_t i = rows.first[block]; i < rows.first[block + 1]; ++i) {
      const double d = r[i] - b.factor[i] * mean[1 - block % 2][b.bin[i]];
      left += d * d;
      all += r[i] * r[i];
    }
  return all > 0 ? std::max(0.0, 1 - left / all) : 0;
}

}  // namespace

std::vector<ResidualMap> maps_of(const Problem& problem, const Column& residual,
                                 const Options& options) {
  const FitRows rows = fit_rows(problem, options.blocks);
  std::vector<double> r;
  for (const std::size_t i : rows.rows) r.push_back(residual[i]);
  std::vector<ResidualMap> maps;
  std::mt19937_64 random(options.seed);
  for (const Coordinate& c : problem.coordinates) {
    const Binned b = binned(c, rows);
    ResidualMap map;
    map.variable = c.name;
    map.unit = c.unit;
    map.share = share(b, rows, r);
    // Chance: the same residual, whole blocks of it put elsewhere.
    unsigned better = 0;
    std::vector<std::size_t> order(rows.blocks());
    for (unsigned k = 0; k < kPermutations; ++k) {
      std::iota(order.begin(), order.end(), std::size_t{0});
      for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random() % i]);
      std::vector<double> moved;
      moved.reserve(r.size());
      for (const std::size_t block : order)
        moved.insert(moved.end(), r.begin() + static_cast<long>(rows.first[block]),
                     r.begin() + static_cast<long>(rows.first[block + 1]));
      if (share(b, rows, moved) >= map.share) ++better;
    }
    map.probability = std::min(1.0, (1.0 + better) / (1.0 + kPermutations));
    map.at = b.at;
    map.mean.assign(b.bins, 0);
    std::vector<double> weight(b.bins, 0);
    for (std::size_t i = 0; i < r.size(); ++i) {
      map.mean[b.bin[i]] += b.factor[i] * r[i];
      weight[b.bin[i]] += b.factor[i] * b.factor[i];
    }
    for (std::size_t k = 0; k < b.bins; ++k) map.mean[k] /= std::max(1e-300, weight[k]);
    maps.push_back(std::move(map));
  }
  std::stable_sort(maps.begin(), maps.end(),
                   [](const ResidualMap& a, const ResidualMap& b) { return a.share > b.share; });
  // False maps among all of them (Benjamini and Hochberg 1995).
  std::vector<std::size_t> by_chance(maps.size());
  std::iota(by_chance.begin(), by_chance.end(), std::size_t{0});
  std::stable_sort(by_chance.begin(), by_chance.end(), [&](std::size_t a, std::size_t b) {
    return maps[a].probability < maps[b].probability;
  });
  double least = 1;
  for (std::size_t k = by_chance.size(); k-- > 0;) {
    ResidualMap& map = maps[by_chance[k]];
    least = std::min(
        least, map.probability * static_cast<double>(maps.size()) / static_cast<double>(k + 1));
    map.probability = least;
  }
  return maps;
}

}  // namespace servosense::reconcile
