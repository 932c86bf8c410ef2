#include "comparator.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "analysis.hpp"

namespace blind {
namespace {

/// Value of `key` in the first section that has it; 0 when none does.
double key_value(const std::string& ini, const std::string& key) {
  const auto at = ini.find("\n" + key + " = ");
  return at == std::string::npos ? 0 : std::strtod(ini.c_str() + at + key.size() + 4, nullptr);
}

const Column* find(const Case& c, const std::string& name) {
  const auto found = std::ranges::find(c.columns, name, &Column::name);
  return found == c.columns.end() ? nullptr : &*found;
}

/// The column with invalid values held.
Signal held(const Column& column, double factor) {
  Signal values = column.values;
  double last = 0;
  for (double& v : values) {
    if (std::isnan(v) || v == kAbsent)
      v = last;
    else
      v *= factor;
    last = v;
  }
  return values;
}

struct Term {
  std::string name;  ///< empty: a term the model has
  Signal column;
};

}  // namespace

std::vector<std::string> plain_library(const Case& c) {
  constexpr double kCutoff_Hz = 80;
  constexpr double kPi = std::numbers::pi;
  const bool turns = c.name.starts_with("spindle");
  if (!turns && !c.name.starts_with("drive")) return {};
  const std::string channel = turns ? "spindle" : "x";
  const double turn = turns ? 2 * kPi : key_value(c.machine, "lead_m");
  const Column* counts = find(c, channel + ".angle_counts");
  const Column* motion =
      counts ? counts : find(c, channel + (turns ? ".angle_rad" : ".position_m"));
  const Column* current = find(c, channel + ".current_A");
  if (!motion || !current) return {};
  const double unit = counts ? turn / key_value(c.machine, "encoder_counts_per_rev") : 1;
  const double gain =
      key_value(c.machine, turns ? "torque_constant_Nm_per_A" : "force_constant_N_per_A");
  const Column* time = find(c, "t_s");
  if (!time || time->values.size() < 2) return {};
  double period = 1;  // of the rows, some of which are missing
  for (std::size_t i = 1; i < time->values.size(); ++i)
    period = std::min(period, time->values[i] - time->values[i - 1]);
  const double rate = 1 / period;

  const auto thin = std::max<std::size_t>(1, static_cast<std::size_t>(rate / (4 * kCutoff_Hz)));
  const auto smooth = [&](const Signal& x) { return low_pass(x, rate, kCutoff_Hz); };
  const auto skip = static_cast<std::size_t>(0.5 * rate);
  const auto sample = [&](const Signal& x) {
    Signal out;
    for (std::size_t i = skip; i + skip / 4 < x.size(); i += thin) out.push_back(x[i]);
    return out;
  };
  const Signal position = held(*motion, unit);
  const Signal x = smooth(position);
  const Signal v = derivative(x, rate);
  const Signal a = derivative(v, rate);
  const Signal raw = held(*current, gain);
  const Signal u = smooth(raw);
  const Signal s = smooth(soft_sign(position, turns ? 1e-3 : 3e-6));
  const double top = *std::ranges::max_element(v);

  std::vector<Term> terms;
  const auto add = [&](const std::string& name, auto&& value) {
    Signal column(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) column[i] = value(i);
    terms.push_back({name, sample(column)});
  };
  const double seconds = static_cast<double>(x.size()) / rate;
  const double middle = (*std::ranges::min_element(x) + *std::ranges::max_element(x)) / 2;
  const double lost = 1e-300;
  add(key_value(c.machine, turns ? "inertia_kg_m2" : "equivalent_mass_kg") > lost ? "" : "mass",
      [&](std::size_t i) { return a[i]; });
  const bool has_viscous = key_value(c.machine, turns ? "viscous_friction_Nm_s_per_rad"
                                                      : "viscous_friction_N_s_per_m") > lost;
  const bool has_coulomb =
      key_value(c.machine, turns ? "coulomb_friction_Nm" : "coulomb_friction_N") > lost;
  add(has_viscous ? "" : "viscous-friction", [&](std::size_t i) { return v[i]; });
  add(has_coulomb ? "" : "coulomb-friction", [&](std::size_t i) { return s[i]; });
  add("constant-load", [](std::size_t) { return 1.0; });
  add("asymmetric-friction", [&](std::size_t i) { return std::abs(v[i]); });
  add("quadratic-drag", [&](std::size_t i) { return v[i] * std::abs(v[i]); });
  for (const double part : {0.01, 0.025, 0.06})
    add("stribeck-friction", [&](std::size_t i) {
      const double q = v[i] / (part * top);
      return s[i] * std::exp(-q * q);
    });
  add("thermal-friction-drift",
      [&](std::size_t i) { return s[i] * static_cast<double>(i) / rate / seconds; });
  if (!turns) {
    add("spring-load", [&](std::size_t i) { return x[i] - middle; });
    add("position-dependent-friction", [&](std::size_t i) { return s[i] * (x[i] - middle); });
  }
  add("load-dependent-friction", [&](std::size_t i) { return s[i] * std::abs(u[i]); });
  for (const double order : {1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0}) {
    add("torque-ripple", [&](std::size_t i) { return std::sin(2 * kPi * order * x[i] / turn); });
    add("torque-ripple", [&](std::size_t i) { return std::cos(2 * kPi * order * x[i] / turn); });
  }
  add("encoder-eccentricity",
      [&](std::size_t i) { return v[i] * v[i] * std::sin(2 * kPi * x[i] / turn); });
  add("encoder-eccentricity",
      [&](std::size_t i) { return v[i] * v[i] * std::cos(2 * kPi * x[i] / turn); });
  const Signal jerk = derivative(u, rate);
  add("transport-delay", [&](std::size_t i) { return jerk[i]; });
  const Signal snap = derivative(derivative(a, rate), rate);
  add("flexible-coupling", [&](std::size_t i) { return snap[i]; });
  // Distance since the last reversal stands for what remembers it.
  Signal travel(x.size(), 0.0);
  for (std::size_t i = 1; i < x.size(); ++i)
    travel[i] = v[i] * v[i - 1] < 0 ? 0 : travel[i - 1] + std::abs(x[i] - x[i - 1]);
  const double scale = turns ? 1e-2 : 3e-5;
  add("presliding-hysteresis", [&](std::size_t i) { return s[i] * std::exp(-travel[i] / scale); });
  add("backlash", [&](std::size_t i) { return a[i] * std::exp(-travel[i] / scale); });
  Signal other;
  if (const Column* y = find(c, "y.current_A")) {
    other = smooth(held(*y, 1));
    add("cross-talk", [&](std::size_t i) { return other[i]; });
  }

  // Thresholds on the share of the effort that a term carries.
  const Signal target = sample(u);
  const std::size_t n = target.size();
  const double floor = 1e-9 + rms(target, 0, n);
  std::vector<std::size_t> best;
  double best_aic = 1e300;
  std::vector<double> best_size;
  for (const double threshold : {0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1}) {
    std::vector<std::size_t> kept(terms.size());
    for (std::size_t i = 0; i < kept.size(); ++i) kept[i] = i;
    Fit fit;
    std::vector<double> size;
    for (int round = 0; round < 10; ++round) {
      std::vector<Signal> columns;
      for (const std::size_t i : kept) columns.push_back(terms[i].column);
      fit = least_squares(columns, target, 0, n);
      std::vector<std::size_t> next;
      size.clear();
      for (std::size_t k = 0; k < kept.size(); ++k) {
        const double carried = std::abs(fit.coefficients[k]) * rms(columns[k], 0, n) / floor;
        if (terms[kept[k]].name.empty() || carried >= threshold) {
          next.push_back(kept[k]);
          size.push_back(carried);
        }
      }
      if (next.size() == kept.size()) break;
      kept = next;
    }
    const double variance = std::pow(rms(fit.residual, 0, n), 2);
    const double aic =
        static_cast<double>(n) * std::log(variance) + 2 * static_cast<double>(kept.size());
    if (aic < best_aic) best_aic = aic, best = kept, best_size = size;
  }
  std::vector<std::size_t> order(best.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::ranges::sort(order,
                    [&](std::size_t p, std::size_t q) { return best_size[p] > best_size[q]; });
  std::vector<std::string> names;
  for (const std::size_t k : order) {
    const std::string& name = terms[best[k]].name;
    if (!name.empty() && std::ranges::find(names, name) == names.end()) names.push_back(name);
  }
  return names;
}

}  // namespace blind
