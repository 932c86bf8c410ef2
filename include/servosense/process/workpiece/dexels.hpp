// Parallel lines through a workpiece, and where on each of them there is material.
//
// A line with one stretch of material, as most have, is two floats in place; one with several is
// the number of a list, kept in the bits of the first. Floats hold 0.2 m to 12 nm.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace servosense::process {

/// A stretch of material, low < high.
struct Stretch {
  float low = 1, high = 0;
};

class Dexels {
 public:
  explicit Dexels(std::size_t count = 0) : lines_(count) {}
  [[nodiscard]] std::size_t size() const { return lines_.size(); }

  /// From low to high.
  [[nodiscard]] std::span<const Stretch> of(std::size_t line) const {
    const Stretch& only = lines_[line];
    if (only.low < only.high) return {&only, 1};
    if (only.high != kListed) return {};
    return lists_[list_of(only)];
  }
  void set(std::size_t line, std::span<const Stretch> stretches) {
    free_list(line);
    if (stretches.size() == 1)
      lines_[line] = stretches[0];
    else if (!stretches.empty())
      new_list(line).assign(stretches.begin(), stretches.end());
  }
  /// Takes out what lies between `low` and `high`; removed(from, to) hears of each part of it.
  template <typename Removed>
  void subtract(std::size_t line, float low, float high, const Removed& removed) {
    Stretch& only = lines_[line];
    if (!(only.low < only.high) && only.high != kListed) return;
    if (only.high != kListed) {
      if (low >= only.high || high <= only.low) return;
      const float from = std::max(low, only.low), to = std::min(high, only.high);
      removed(from, to);
      const bool below = from > only.low, above = to < only.high;
      if (below && above) {
        const Stretch parts[2] = {{only.low, from}, {to, only.high}};
        new_list(line).assign(parts, parts + 2);
      } else if (below) {
        only.high = from;
      } else if (above) {
        only.low = to;
      } else {
        only = {};
      }
      return;
    }
    subtract_listed(line, low, high, removed);
  }
  [[nodiscard]] bool holds(std::size_t line, float at, float margin) const {
    for (const Stretch& s : of(line))
      if (at > s.low + margin && at < s.high - margin) return true;
    return false;
  }
  [[nodiscard]] bool meets(std::size_t line, float low, float high) const {
    for (const Stretch& s : of(line))
      if (s.low < high && s.high > low) return true;
    return false;
  }
  /// Upper end of the highest stretch, or `none`.
  [[nodiscard]] float top(std::size_t line, float none) const {
    const auto all = of(line);
    return all.empty() ? none : all.back().high;
  }
  [[nodiscard]] double length(std::size_t line) const {
    double sum = 0;
    for (const Stretch& s : of(line))
      sum += static_cast<double>(s.high) - static_cast<double>(s.low);
    return sum;
  }

 private:
  static constexpr float kListed = -1e30F;

  [[nodiscard]] static std::size_t list_of(const Stretch& line) {
    return std::bit_cast<std::uint32_t>(line.low);
  }
  std::vector<Stretch>& new_list(std::size_t line) {
    std::size_t number = lists_.size();
    if (!unused_.empty())
      number = unused_.back(), unused_.pop_back();
    else
      lists_.emplace_back();
    lines_[line] = {std::bit_cast<float>(static_cast<std::uint32_t>(number)), kListed};
    return lists_[number];
  }
  void free_list(std::size_t line) {
    if (lines_[line].high == kListed) {
      const std::size_t number = list_of(lines_[line]);
      lists_[number] = {};
      unused_.push_back(static_cast<std::uint32_t>(number));
    }
    lines_[line] = {};
  }
  template <typename Removed>
  void subtract_listed(std::size_t line, float low, float high, const Removed& removed) {
    std::vector<Stretch>& all = lists_[list_of(lines_[line])];
    for (std::size_t i = 0; i < all.size();) {
      Stretch& s = all[i];
      if (low >= s.high || high <= s.low) {
        ++i;
        continue;
      }
      const float from = std::max(low, s.low), to = std::min(high, s.high);
      removed(from, to);
      const bool below = from > s.low, above = to < s.high;
      if (below && above) {
        const Stretch upper{to, s.high};
        s.high = from;
        all.insert(all.begin() + static_cast<std::ptrdiff_t>(i) + 1, upper);
        i += 2;
      } else if (below) {
        s.high = from;
        ++i;
      } else if (above) {
        s.low = to;
        ++i;
      } else {
        all.erase(all.begin() + static_cast<std::ptrdiff_t>(i));
      }
    }
    if (all.size() > 1) return;
    const Stretch left = all.empty() ? Stretch{} : all[0];
    free_list(line);
    lines_[line] = left;
  }

  std::vector<Stretch> lines_;  // low > high: nothing; high == kListed: low is the number of a list
  std::vector<std::vector<Stretch>> lists_;
  std::vector<std::uint32_t> unused_;
};

}  // namespace servosense::process
