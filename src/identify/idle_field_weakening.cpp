#include "idle_field_weakening.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::idle_fit {
namespace {

constexpr double kEvidence = 4;        // standard errors from one law to another
constexpr double kLeastFall = 0.02;    // at top speed: less is within the error of any constant
constexpr double kOtherLaw = 0.05;     // of the exponent: nearer to 1 it is constant power
constexpr double kOtherTable = 0.01;   // of the current per torque: a law so near is as good
constexpr double kLeastBase = 0.1;     // of top speed
constexpr double kHighestBase = 0.97;  // likewise
constexpr int kGrid = 60;
constexpr int kSteps = 6;  // of Gauss and Newton
constexpr std::size_t kKnots = kMaxEffectValues / 2;

struct Law {
  double base = 0;
  double exponent = 1;
  /// Current per torque, in units of that at low speed.
  [[nodiscard]] double ratio(double speed) const {
    return std::abs(speed) > base ? std::pow(std::abs(speed) / base, exponent) : 1;
  }
};

/// Current per torque at knots, linear in between.
struct Table {
  std::vector<double> speed, ratio;
  /// Of a knot, at this speed.
  [[nodiscard]] double weight(std::size_t knot, double at) const {
    const double v = std::clamp(std::abs(at), speed.front(), speed.back());
    if (knot > 0 && v < speed[knot])
      return std::max(0.0, (v - speed[knot - 1]) / (speed[knot] - speed[knot - 1]));
    if (knot + 1 < speed.size() && v > speed[knot])
      return std::max(0.0, (speed[knot + 1] - v) / (speed[knot + 1] - speed[knot]));
    return v == speed[knot] ? 1 : 0;
  }
  [[nodiscard]] double at(double v) const {
    double sum = 0;
    for (std::size_t k = 0; k < speed.size(); ++k) sum += ratio[k] * weight(k, v);
    return sum;
  }
};

class Search {
 public:
  Search(const IdleDesign& design, const Columns& columns) : design_(design), columns_(columns) {
    for (const double v : design.viscous) {
      top_ = std::max(top_, std::abs(v));
      drag_.push_back(v * std::abs(v));
    }
  }

  [[nodiscard]] double top() const { return top_; }
  [[nodiscard]] double residual(const Law& law) const {
    return fitted([&](double v) { return law.ratio(v); }).residual_rms;
  }
  /// Of a constant that holds, with drag in the square of speed or without.
  [[nodiscard]] double residual_of_constant() const {
    Columns with = columns_;
    with.push_back(&drag_);
    return std::min(regress(columns_, design_.output, 0).residual_rms,
                    regress(with, design_.output, 0).residual_rms);
  }

  /// The base speed of constant power that fits best.
  [[nodiscard]] Law best() const {
    const double step = std::pow(kHighestBase / kLeastBase, 1.0 / (kGrid - 1));
    Law law{kLeastBase * top_, 1};
    Law found = law;
    double least = residual(law);
    for (int i = 1; i < kGrid; ++i) {
      law.base *= step;
      if (const double r = residual(law); r < least) least = r, found = law;
    }
    return found;
  }

  /// From there by Gauss and Newton, beside drag, which looks alike.
  [[nodiscard]] FoundWeakening refined(Law law, bool exponent_too) const {
    Regression r;
    const auto n = static_cast<Eigen::Index>(columns_.size()) + 1;
    for (int i = 0; i < kSteps; ++i) {
      const Column torque = torque_of([&](double v) { return law.ratio(v); });
      Column by_base(torque.size(), 0.0), by_exponent(torque.size(), 0.0);
      for (std::size_t k = 0; k < torque.size(); ++k) {
        const double speed = std::abs(design_.viscous[k]);
        if (!(speed > law.base)) continue;
        by_base[k] = -law.exponent / law.base * law.ratio(speed) * torque[k];
        by_exponent[k] = std::log(speed / law.base) * law.ratio(speed) * torque[k];
      }
      Columns rates = {&by_base};
      if (exponent_too) rates.push_back(&by_exponent);
      r = linearised([&](double v) { return law.ratio(v); }, rates, i + 1 == kSteps);
      law.base += std::clamp(r.parameters(n), -0.05 * top_, 0.05 * top_);
      law.base = std::clamp(law.base, kLeastBase * top_ / 2, top_);
      if (!exponent_too) continue;
      law.exponent += std::clamp(r.parameters(n + 1), -0.2, 0.2);
      law.exponent = std::clamp(law.exponent, 0.0, 3.0);
    }
    return {{law.base, r.standard_errors(n)},
            {law.exponent, exponent_too ? r.standard_errors(n + 1) : 0},
            {}};
  }

  /// A table in place of the law, from it: flat up to a quarter of its base speed. Empty where it
  /// fits no better.
  [[nodiscard]] std::vector<std::pair<double, Estimate>> tabled(const Law& law) const {
    Table table;
    const double first = law.base / 4;
    const double step = std::pow(top_ / first, 1.0 / (kKnots - 1));
    for (std::size_t k = 0; k < kKnots; ++k) {
      table.speed.push_back(first * std::pow(step, static_cast<double>(k)));
      table.ratio.push_back(law.ratio(table.speed.back()));
    }
    table.ratio[0] = 1;
    Regression r;
    const auto n = static_cast<Eigen::Index>(columns_.size()) + 1;
    const auto ratio = [&](double v) { return table.at(v); };
    for (int i = 0; i < kSteps; ++i) {
      const Column torque = torque_of(ratio);
      std::vector<Column> rates(kKnots - 1, torque);
      Columns all;
      for (std::size_t k = 1; k < kKnots; ++k) {
        for (std::size_t row = 0; row < torque.size(); ++row)
          rates[k - 1][row] *= table.weight(k, design_.viscous[row]);
        all.push_back(&rates[k - 1]);
      }
      r = linearised(ratio, all, i + 1 == kSteps);
      for (std::size_t k = 1; k < kKnots; ++k)
        table.ratio[k] =
            std::max(0.1, table.ratio[k] + r.parameters(n + static_cast<Eigen::Index>(k) - 1));
    }
    if (!(fitted(ratio).residual_rms < residual(law))) return {};
    std::vector<std::pair<double, Estimate>> out = {{table.speed[0], {1, 0}}};
    for (std::size_t k = 1; k < kKnots; ++k)
      out.push_back({table.speed[k],
                     {table.ratio[k], r.standard_errors(n + static_cast<Eigen::Index>(k) - 1)}});
    return out;
  }

 private:
  template <typename Ratio>
  [[nodiscard]] std::vector<Column> times(Ratio ratio, const Columns& columns) const {
    std::vector<Column> out;
    for (const Column* column : columns) {
      out.push_back(*column);
      for (std::size_t i = 0; i < column->size(); ++i) out.back()[i] *= ratio(design_.viscous[i]);
    }
    return out;
  }
  static Columns pointers(const std::vector<Column>& columns) {
    Columns all;
    for (const Column& column : columns) all.push_back(&column);
    return all;
  }
  template <typename Ratio>
  [[nodiscard]] Regression fitted(Ratio ratio) const {
    const std::vector<Column> scaled = times(ratio, columns_);
    return regress(pointers(scaled), design_.output, 0);
  }
  /// What the motor gives, as fitted under this law.
  template <typename Ratio>
  [[nodiscard]] Column torque_of(Ratio ratio) const {
    const Regression fit = fitted(ratio);
    Column torque(design_.output.size(), 0.0);
    for (std::size_t j = 0; j < columns_.size(); ++j)
      for (std::size_t i = 0; i < torque.size(); ++i)
        torque[i] += fit.parameters(static_cast<Eigen::Index>(j)) * (*columns_[j])[i];
    return torque;
  }
  /// Columns, drag, and the rates at which the fit moves with the parameters of a law.
  template <typename Ratio>
  [[nodiscard]] Regression linearised(Ratio ratio, const Columns& rates, bool with_errors) const {
    Columns motion = columns_;
    motion.push_back(&drag_);
    const std::vector<Column> scaled = times(ratio, motion);
    Columns all = pointers(scaled);
    all.insert(all.end(), rates.begin(), rates.end());
    return regress(all, design_.output, with_errors ? design_.lag() : 0);
  }

  const IdleDesign& design_;
  Columns columns_;
  Column drag_;
  double top_ = 0;
};

}  // namespace

std::optional<FoundWeakening> find_field_weakening(const IdleDesign& design,
                                                   const Columns& columns) {
  const Search search(design, columns);
  const Law power = search.best();
  if (!(search.residual(power) < search.residual_of_constant())) return {};
  FoundWeakening found = search.refined(power, true);
  const Estimate exponent = found.exponent;
  const Law free{found.base_speed.value, exponent.value};
  if (!(exponent.value > kEvidence * exponent.standard_error)) return {};
  if (!(1 - 1 / free.ratio(search.top()) > kLeastFall)) return {};
  const double other = std::abs(exponent.value - 1);
  if (!(other > kOtherLaw && other > kEvidence * exponent.standard_error)) {
    found = search.refined(power, false);
    found.exponent = {1, 0};
  }
  const Law law{found.base_speed.value, found.exponent.value};
  std::vector<std::pair<double, Estimate>> table = search.tabled(law);
  for (const auto& [speed, ratio] : table) {
    const double off = std::abs(ratio.value - law.ratio(speed));
    if (off > kEvidence * ratio.standard_error && off > kOtherTable * ratio.value) {
      found.table = std::move(table);
      break;
    }
  }
  return found;
}

}  // namespace servosense::idle_fit
