#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <memory>
#include <utility>

#include "dsp/dense.hpp"
#include "dsp/fourier.hpp"
#include "reconcile/drive/candidates/kinds.hpp"
#include "reconcile/numerics/whole_orders.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

/// Power of a residual at orders low, low + step, ... of a phase [rad], usable rows.
std::vector<double> order_spectrum(const Column& residual, const std::vector<bool>& usable,
                                   const Column& phase, double low, double step, double high) {
  std::size_t orders = 0;
  for (double order = low; order <= high; order += step) ++orders;
  std::vector<double> re(orders, 0), im(orders, 0);
  // A few rows at a time through all orders: their phasors stay in registers.
  constexpr std::size_t kRows = 4;
  std::array<double, kRows> r{}, cosine{}, sine{}, by_cosine{}, by_sine{};
  const auto add = [&](std::size_t rows) {
    for (std::size_t k = 0; k < orders; ++k) {
      for (std::size_t i = 0; i < rows; ++i) {
        re[k] += r[i] * cosine[i];
        im[k] += r[i] * sine[i];
      }
      for (std::size_t i = 0; i < kRows; ++i) {
        const double turned = cosine[i] * by_cosine[i] - sine[i] * by_sine[i];
        sine[i] = cosine[i] * by_sine[i] + sine[i] * by_cosine[i];
        cosine[i] = turned;
      }
    }
  };
  std::size_t filled = 0;
  for (std::size_t i = 0; i < residual.size(); ++i) {
    if (!usable[i]) continue;
    r[filled] = residual[i];
    cosine[filled] = std::cos(low * phase[i]);
    sine[filled] = std::sin(low * phase[i]);
    by_cosine[filled] = std::cos(step * phase[i]);
    by_sine[filled] = std::sin(step * phase[i]);
    if (++filled == kRows) {
      add(kRows);
      filled = 0;
    }
  }
  add(filled);
  std::vector<double> power(orders);
  for (std::size_t k = 0; k < orders; ++k) power[k] = re[k] * re[k] + im[k] * im[k];
  return power;
}

/// Places of the highest peaks of a spectrum.
std::vector<std::size_t> highest_peaks(const std::vector<double>& power, std::size_t count) {
  std::vector<std::size_t> peaks;
  for (std::size_t i = 0; i < power.size(); ++i)
    if ((i == 0 || power[i] >= power[i - 1]) && (i + 1 == power.size() || power[i] > power[i + 1]))
      peaks.push_back(i);
  std::stable_sort(peaks.begin(), peaks.end(),
                   [&](std::size_t a, std::size_t b) { return power[a] > power[b]; });
  if (peaks.size() > count) peaks.resize(count);
  return peaks;
}

constexpr std::size_t kMostLines = 3;

double power_of_usable(const Column& residual, const std::vector<bool>& usable) {
  double power = 0;
  for (std::size_t i = 0; i < residual.size(); ++i)
    if (usable[i]) power += residual[i] * residual[i];
  return power;
}

/// What sines of these orders leave of a residual, and its power.
double without_lines(const Column& residual, const std::vector<bool>& usable, const Column& phase,
                     const std::vector<double>& orders, Column& rest) {
  const auto n = static_cast<Eigen::Index>(2 * orders.size());
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n), row(n);
  Eigen::MatrixXd lines(n, static_cast<Eigen::Index>(residual.size()));
  for (std::size_t i = 0; i < residual.size(); ++i) {
    if (!usable[i]) continue;
    for (std::size_t k = 0; k < orders.size(); ++k) {
      row(static_cast<Eigen::Index>(2 * k)) = std::sin(orders[k] * phase[i]);
      row(static_cast<Eigen::Index>(2 * k + 1)) = std::cos(orders[k] * phase[i]);
    }
    lines.col(static_cast<Eigen::Index>(i)) = row;
    gram += row * row.transpose();
    right += residual[i] * row;
  }
  const Eigen::VectorXd c = dense::solve_symmetric(gram, right);
  rest = residual;
  double power = 0;
  for (std::size_t i = 0; i < residual.size(); ++i) {
    if (!usable[i]) continue;
    row = lines.col(static_cast<Eigen::Index>(i));
    rest[i] -= c.dot(row);
    power += rest[i] * rest[i];
  }
  return power;
}

/// Calls with(row of the residual, sine and cosine of each whole order there behind a one).
template <typename With>
void for_whole_orders(const std::vector<bool>& usable, const Column& phase, int highest,
                      With with) {
  Eigen::VectorXd row(1 + 2 * highest);
  row(0) = 1;
  for (std::size_t i = 0; i < phase.size(); ++i) {
    if (!usable[i]) continue;
    const std::complex<double> turn = std::polar(1.0, phase[i]);
    std::complex<double> at = turn;
    for (Eigen::Index k = 1; k < row.size(); k += 2) {
      row(k) = at.imag();
      row(k + 1) = at.real();
      at *= turn;
    }
    with(i, row);
  }
}

/// What whole orders have of each other, whatever the residual.
Eigen::MatrixXd gram_of_whole_orders(const std::vector<bool>& usable, const Column& phase,
                                     int highest) {
  const Eigen::Index n = 1 + 2 * highest;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(n, n);
  for_whole_orders(usable, phase, highest, [&](std::size_t /*i*/, const Eigen::VectorXd& row) {
    gram.selfadjointView<Eigen::Lower>().rankUpdate(row);
  });
  return gram.selfadjointView<Eigen::Lower>();
}

/// Whole orders up to `highest` that leave least of a residual, the first, then the best beside it,
/// and so on.
struct WholeOrder {
  double order = 0;
  bool stands_out = false;  // no other order of the rest has half its amplitude
};
std::vector<WholeOrder> whole_orders(const Column& residual, const std::vector<bool>& usable,
                                     const Column& phase, int highest, const Eigen::MatrixXd& gram,
                                     std::size_t count) {
  Eigen::VectorXd right = Eigen::VectorXd::Zero(gram.rows());
  for_whole_orders(usable, phase, highest,
                   [&](std::size_t i, const Eigen::VectorXd& row) { right += residual[i] * row; });
  WholeOrders found(gram, std::move(right), 1);
  std::vector<WholeOrder> orders;
  while (orders.size() < count) {
    const WholeOrders::Next next = found.next();
    if (next.order == 0) break;
    orders.push_back({static_cast<double>(next.order), next.more > 4 * next.second});
    found.add(next.order);
  }
  return orders;
}

constexpr double kHighestLine = 2.2;  // corners: what the filter leaves of it there still counts

/// Share of a ripple's power that the filter leaves, at the speeds of this motion.
double power_shown(const DriveSignals& s, double order, double unit) {
  double sum = 0, rows = 0;
  for (std::size_t i = 0; i < s.usable.size(); ++i) {
    if (!s.usable[i]) continue;
    const double f = order * s.velocity_rows[i] / unit / s.corner_hz;
    sum += std::exp2(-f * f);
    ++rows;
  }
  return rows > 0 ? sum / rows : 0;
}

/// A ripple that is faster than the band at nearly all speeds of the motion hardly shows.
void say_what_is_beyond_the_band(Candidate& c, const DriveSituation& situation, double unit,
                                 double highest) {
  const DriveSignals& s = *situation.signals;
  const bool turns = situation.data->turns();
  double shown = std::floor(highest);
  while (shown > 0 && power_shown(s, shown, unit) < situation.criteria->ripple_shown) --shown;
  if (shown >= std::floor(highest)) return;
  c.part_not_testable = "at the speeds of this motion orders above " + printed(shown, 2) +
                        " are faster than the comparison's " + printed(s.corner_hz, 2) + " Hz";
  c.part_would_need = "some turns at " + printed(s.corner_hz * unit / highest, 2) +
                      (turns ? " rad/s" : " m/s") + " or slower, both ways";
}

/// Orders that a residual shows, read off its order spectrum.
struct RippleOrders {
  std::shared_ptr<const DriveSignals> signals;
  Column turn_phase;
  double highest, step, turns;
  const Criteria* criteria;
  std::shared_ptr<Eigen::MatrixXd> gram = std::make_shared<Eigen::MatrixXd>();

  [[nodiscard]] std::vector<std::vector<double>> starts(const Column& residual) const;
};

std::vector<std::vector<double>> RippleOrders::starts(const Column& residual) const {
  std::vector<std::vector<double>> all;
  if (turns < 1.5) return all;
  // A finer comb than an eighth would find the record's own beat; refinement does the rest.
  const double comb = std::max(0.125, step);
  // One line after the other, each of the strongest with what it leaves.
  const auto strongest = [&](const Column& rest, std::size_t count) {
    std::vector<double> orders;
    for (const std::size_t k : highest_peaks(
             order_spectrum(rest, signals->usable, turn_phase, 0.5, comb, highest), count))
      orders.push_back(0.5 + comb * static_cast<double>(k));
    return orders;
  };
  for (const double order : strongest(residual, 4)) all.push_back({order});
  if (all.empty()) return all;
  // More of them as long as each is a line of its own; `next` gives the one after `lines`.
  const auto add_lines = [&](std::vector<double> lines, const auto& next) {
    Column rest;
    double left = without_lines(residual, signals->usable, turn_phase, lines, rest);
    const double least =
        criteria->line_share_of_first * (power_of_usable(residual, signals->usable) - left);
    while (lines.size() < kMostLines) {
      const WholeOrder line = next(lines.size(), rest);
      if (!(line.order > 0)) break;
      lines.push_back(line.order);
      const double less = without_lines(residual, signals->usable, turn_phase, lines, rest);
      const double needed = line.stands_out ? least : std::max(criteria->line_share * left, least);
      if (!(left - less > needed)) break;
      all.push_back(lines);
      left = less;
    }
  };
  add_lines(all[0], [&](std::size_t, const Column& rest) {
    const std::vector<double> next = strongest(rest, 1);
    return next.empty() ? WholeOrder{} : WholeOrder{next[0], false};
  });
  // Poles, slots and a screw's turn make whole orders.
  const int highest_whole = static_cast<int>(highest);
  if (gram->size() == 0) *gram = gram_of_whole_orders(signals->usable, turn_phase, highest_whole);
  const std::vector<WholeOrder> whole =
      whole_orders(residual, signals->usable, turn_phase, highest_whole, *gram, kMostLines);
  if (whole.empty()) return all;
  all.push_back({whole[0].order});
  add_lines({whole[0].order}, [&](std::size_t k, const Column&) {
    return k < whole.size() ? whole[k] : WholeOrder{};
  });
  return all;
}

}  // namespace

/// Friction at even knots over the stroke; its mean belongs to Coulomb friction.
Candidate profile_candidate(std::size_t effect, const DriveSituation& s) {
  Candidate c = effect_candidate(effect, s);
  const double from = s.low, to = s.high;
  c.search = {{2, 2, 1, false}};  // knots: as few as carry the gap
  c.starts = [](const Column&) {
    std::vector<std::vector<double>> all;
    for (const double knots : {2.0, 3.0, 5.0, 8.0}) all.push_back({knots});
    return all;
  };
  const auto setting = [effect, from, to](std::size_t knots, std::span<const double> values) {
    EffectSetting e;
    e.effect = effect;
    e.parameters[0].count = 2 * knots;
    for (std::size_t k = 0; k < knots; ++k) {
      e.parameters[0].value[2 * k] =
          from + (to - from) * static_cast<double>(k) / static_cast<double>(knots - 1);
      e.parameters[0].value[2 * k + 1] = values[k];
    }
    return e;
  };
  // Without a knot less, the sum of all would be Coulomb friction itself.
  c.columns = [s, setting](std::span<const double> theta) -> std::vector<Column> {
    const auto knots = static_cast<std::size_t>(theta[0]);
    std::vector<Column> out;
    for (std::size_t k = 1; k < knots; ++k) {
      std::vector<double> values(knots, 0);
      values[k] = 1;
      out.push_back(s.signals->response(setting(knots, values), s.model));
      if (out.back().empty()) return {};
    }
    return out;
  };
  c.meaning = [setting](std::span<const double> theta, std::span<const double> coefficients) {
    const auto knots = static_cast<std::size_t>(theta[0]);
    std::vector<double> values(knots, 0);
    for (std::size_t k = 1; k < knots; ++k) values[k] = coefficients[k - 1];
    const EffectSetting e = setting(knots, values);
    Meaning m;
    m.parameters.push_back({"profile",
                            {e.parameters[0].value.begin(),
                             e.parameters[0].value.begin() + static_cast<long>(2 * knots)},
                            {}});
    return m;
  };
  return c;
}

/// Ripple: orders from the order spectrum, each with sine and cosine.
Candidate ripple_candidate(std::size_t effect, const DriveSituation& s) {
  Candidate c = effect_candidate(effect, s);
  const double unit = s.model.unit_per_turn;
  if (!(unit > 0)) {
    c.not_testable = "the length of a turn is not known";
    c.would_need = "lead_m in the machine file";
    return c;
  }
  Column phase = s.signals->position_rows;
  for (double& x : phase) x *= kTwoPi / unit;
  const double turns = s.travel / unit;
  const double highest = kDriveEffectTraits[effect].search[0].high;
  say_what_is_beyond_the_band(c, s, unit, highest);
  const double step = std::clamp(0.5 / std::max(turns, 1e-9), 0.01, 0.5);
  c.search = {{0.2, highest, 1, false, step}};
  const Column turn_phase = phase;
  c.starts = [finder = RippleOrders{s.signals, turn_phase, highest, step, turns, s.criteria}](
                 const Column& residual) { return finder.starts(residual); };
  // One order is moved at a time: the columns of the others are kept.
  struct Line {
    double order = 0;
    Column sine, cosine;
  };
  const auto lines = std::make_shared<std::vector<Line>>();
  c.columns = [s, effect, lines](std::span<const double> theta) {
    std::vector<Column> out;
    for (const double order : theta) {
      auto line = std::find_if(lines->begin(), lines->end(),
                               [&](const Line& l) { return l.order == order; });
      if (line == lines->end()) {
        if (lines->size() > 2 * kMostLines) lines->erase(lines->begin());
        const auto wave = [&](double phase_rad) {
          return s.signals->response(effect_with(effect, {order, 1, phase_rad}), s.model);
        };
        lines->push_back({order, wave(0), wave(kTwoPi / 4)});
        line = lines->end() - 1;
      }
      out.push_back(line->sine);
      out.push_back(line->cosine);
    }
    return out;
  };
  const char* amplitude = kDriveEffects[effect].parameters[1].key_for(s.data->turns());
  c.meaning = [amplitude](std::span<const double> theta, std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{"order", {}, {}}, {amplitude, {}, {}}, {"phase_rad", {}, {}}};
    for (std::size_t k = 0; k < theta.size(); ++k) {
      const double sine = coefficients[2 * k], cosine = coefficients[2 * k + 1];
      m.parameters[0].values.push_back(theta[k]);
      m.parameters[1].values.push_back(std::hypot(sine, cosine));
      m.parameters[2].values.push_back(std::atan2(cosine, sine));
    }
    return m;
  };
  return c;
}

/// A line fixed in time: not of the machine, but it must not be taken for something that is.
Candidate line_candidate(const DriveSituation& s) {
  Candidate c;
  c.name = "time-locked-vibration";
  c.scope = "record";
  c.where = "time";
  c.splitting_motion = "the same move at another speed, and a standstill";
  const double corner = s.signals->corner_hz;
  const double duration = s.duration_s;
  c.search = {{1.0, kHighestLine * corner, 1, false, 0.5 / duration}};
  const double row = s.signals->row_period_s();
  c.starts = [s, corner, duration, row](const Column& residual) {
    std::size_t n = 1;
    while (n < 2 * residual.size()) n *= 2;
    std::vector<std::complex<double>> padded(n), spectrum;
    for (std::size_t i = 0; i < residual.size(); ++i)
      if (s.signals->usable[i]) padded[i] = residual[i];
    FourierTransform().forward(padded, spectrum);
    const double bin_hz = 1 / (static_cast<double>(n) * row);
    const auto from = static_cast<std::size_t>(std::max(3.0, 4 / duration) / bin_hz);
    const auto to = std::min(n / 2, static_cast<std::size_t>(kHighestLine * corner / bin_hz));
    std::vector<double> power;
    for (std::size_t k = from; k < to; ++k) power.push_back(std::norm(spectrum[k]));
    std::vector<std::vector<double>> all;
    for (const std::size_t k : highest_peaks(power, 3))
      all.push_back({bin_hz * static_cast<double>(from + k)});
    return all;
  };
  const std::size_t rows = s.signals->rows();
  c.columns = [rows, row, corner](std::span<const double> theta) {
    const double f = theta[0] / corner;
    const double gain = std::exp2(-0.5 * f * f);
    std::vector<Column> out(2, Column(rows));
    for (std::size_t i = 0; i < rows; ++i) {
      const double phase = kTwoPi * theta[0] * static_cast<double>(i) * row;
      out[0][i] = gain * std::sin(phase);
      out[1][i] = gain * std::cos(phase);
    }
    return out;
  };
  const char* amplitude = s.data->turns() ? "amplitude_Nm" : "amplitude_N";
  c.meaning = [amplitude](std::span<const double> theta, std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{"frequency_hz", {theta[0]}, {}},
                    {amplitude, {std::hypot(coefficients[0], coefficients[1])}, {}}};
    return m;
  };
  return c;
}

}  // namespace servosense::reconcile
