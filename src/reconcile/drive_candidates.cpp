#include "drive_candidates.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <memory>
#include <unsupported/Eigen/FFT>

#include "drive_play.hpp"
#include "machine_section.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kOffBound = 1.05;     // what ends on the bound of its range is something else
constexpr double kLongerThanKnee = 4;  // travel of a presliding effect: shorter is another law

/// Candidate of one effect of the catalogue, driven by its own class.
class EffectCandidate {
 public:
  EffectCandidate(std::size_t effect, const DriveSituation& s)
      : effect_(effect),
        situation_(s),
        info_(kDriveEffects[effect]),
        traits_(kDriveEffectTraits[effect]) {
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) {
      const EffectRole role = traits_.search[p].role;
      if (role == EffectRole::searched || role == EffectRole::scaled) searched_.push_back(p);
    }
  }

  [[nodiscard]] Candidate make() const {
    Candidate c;
    c.name = info_.name;
    c.scope = traits_.scope;
    c.where = traits_.where;
    c.signature = traits_.signature;
    c.splitting_motion = traits_.splitting_motion;
    c.sized = traits_.sized;
    for (const std::size_t p : searched_) c.search.push_back(range(traits_.search[p]));
    const EffectCandidate self = *this;
    c.columns = [self](std::span<const double> theta) { return self.columns(theta); };
    c.meaning = [self](std::span<const double> theta, std::span<const double> coefficients) {
      return self.meaning(theta, coefficients);
    };
    return c;
  }

 private:
  [[nodiscard]] bool turns() const { return situation_.data->turns(); }
  [[nodiscard]] const char* key(std::size_t p) const {
    return info_.parameters[p].key_for(turns());
  }

  [[nodiscard]] SearchRange range(const EffectSearch& s) const {
    // Of the model as given: shorter than that is the same friction seen by another law.
    const double knee = situation_.data->model.friction_knee;
    double unit = 1;
    switch (s.in) {
      case EffectRange::absolute:
        break;
      case EffectRange::of_top_speed:
        unit = situation_.top_speed;
        break;
      case EffectRange::of_record:
        unit = situation_.duration_s;
        break;
      case EffectRange::of_knee:
        unit = knee;
        break;
      case EffectRange::per_knee:
        unit = 1 / knee;
        break;
      case EffectRange::of_band:
        unit = situation_.signals->corner_hz;
        break;
    }
    return {s.low * unit, s.high * unit, s.points};
  }

  /// Every parameter at its default, the searched ones at theta.
  [[nodiscard]] EffectSetting base(std::span<const double> theta) const {
    EffectSetting s;
    s.effect = effect_;
    for (std::size_t p = 0; p < info_.parameter_count(); ++p)
      if (!info_.parameters[p].optional) s.parameters[p].count = 1;
    for (std::size_t k = 0; k < searched_.size() && k < theta.size(); ++k)
      s.parameters[searched_[k]].value[0] = theta[k];
    return s;
  }
  [[nodiscard]] bool add_response(std::vector<Column>& to, const EffectSetting& s) const {
    Column column = situation_.signals->response(s, situation_.model);
    if (column.empty()) return false;
    to.push_back(std::move(column));
    return true;
  }

  /// The response to 1 of a parameter, from that to a value within its range.
  [[nodiscard]] bool add_scaled(std::vector<Column>& to, EffectSetting s, std::size_t p,
                                double value) const {
    s.parameters[p].value[0] = value;
    if (!add_response(to, s)) return false;
    for (double& v : to.back()) v /= value;
    return true;
  }

  [[nodiscard]] std::vector<Column> columns(std::span<const double> theta) const {
    std::vector<Column> out;
    EffectSetting s = base(theta);
    if (traits_.sized) return add_response(out, s) ? out : std::vector<Column>{};
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) {
      EffectSetting unit = s;
      switch (traits_.search[p].role) {
        case EffectRole::linear:
          if (!add_scaled(out, unit, p, std::min(1.0, 0.5 * info_.parameters[p].high))) return {};
          break;
        case EffectRole::amplitude:
          for (const double phase : {0.0, kTwoPi / 4}) {
            for (std::size_t q = 0; q < info_.parameter_count(); ++q)
              if (traits_.search[q].role == EffectRole::phase) {
                unit.parameters[q].value[0] = phase;
                unit.parameters[q].count = 1;
              }
            if (!add_scaled(out, unit, p, std::min(1.0, 0.5 * info_.parameters[p].high))) return {};
          }
          break;
        case EffectRole::offset:
          if (!situation_.constant_known) out.emplace_back(situation_.signals->rows(), 1.0);
          break;
        default:
          break;
      }
    }
    return out;
  }

  [[nodiscard]] Meaning meaning(std::span<const double> theta,
                                std::span<const double> coefficients) const {
    Meaning m;
    const EffectSetting s = base(theta);
    std::array<double, kMaxEffectParameters> value{};
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) value[p] = s.parameters[p].value[0];
    std::size_t at = 0;
    double strength = 1;
    double cosine = 0, sine = 0;
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) {
      const EffectRole role = traits_.search[p].role;
      if (role == EffectRole::linear && at < coefficients.size())
        value[p] = strength = coefficients[at++];
      else if (role == EffectRole::amplitude && at + 1 < coefficients.size()) {
        sine = coefficients[at++];
        cosine = coefficients[at++];
        value[p] = std::hypot(sine, cosine);
      } else if (role == EffectRole::offset && at < coefficients.size()) {
        value[p] = strength != 0 ? -coefficients[at++] / strength : 0;
      }
    }
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) {
      const EffectRole role = traits_.search[p].role;
      if (role == EffectRole::scaled) value[p] *= std::abs(strength);
      if (role == EffectRole::phase) value[p] = std::atan2(cosine, sine);
      const EffectParameter& parameter = info_.parameters[p];
      if (!(value[p] >= parameter.low && value[p] <= parameter.high))
        m.violation = std::string(key(p)) + " would be " + printed(value[p], 3);
      m.parameters.push_back({key(p), {value[p]}, {}});
    }
    return m;
  }

  std::size_t effect_;
  DriveSituation situation_;
  EffectInfo info_;
  EffectTraits traits_;
  std::vector<std::size_t> searched_;
};

/// The load swings on its spring at the antiresonance; its share of the mass is then linear.
Candidate coupling(std::size_t effect, const DriveSituation& s) {
  Candidate c = EffectCandidate(effect, s).make();
  c.search.resize(2);
  c.sized = false;
  const auto setting = [effect](std::span<const double> theta, double share) {
    EffectSetting e;
    e.effect = effect;
    for (auto& p : e.parameters) p.count = 1;
    const double held = std::sqrt(1 - share);
    e.parameters[0].value[0] = theta[0] / held;
    e.parameters[1].value[0] = std::min(1.0, theta[1] / held);
    e.parameters[2].value[0] = share;
    return e;
  };
  c.columns = [s, setting](std::span<const double> theta) -> std::vector<Column> {
    Column column = s.signals->response(setting(theta, 0.5), s.model);
    if (column.empty()) return {};
    for (double& v : column) v *= 2;
    return {std::move(column)};
  };
  const bool turns = s.data->turns();
  c.meaning = [setting, effect, turns](std::span<const double> theta,
                                       std::span<const double> coefficients) {
    Meaning m;
    const double share = coefficients[0];
    const EffectSetting e = setting(theta, std::clamp(share, 0.001, 0.95));
    for (std::size_t p = 0; p < 3; ++p)
      m.parameters.push_back(
          {kDriveEffects[effect].parameters[p].key_for(turns), {p == 2 ? share : e.scalar(p)}, {}});
    if (!(share >= 0.05 && share <= 0.85))
      m.violation = "the load would have " + printed(share, 3) + " of the mass";
    return m;
  };
  return c;
}

/// A long bristle beside a short knee. Which knee is fitted too: alone it would have been fitted to
/// something between the two.
Candidate presliding(std::size_t effect, const DriveSituation& s) {
  Candidate c = EffectCandidate(effect, s).make();
  const double knee = s.model.friction_knee;
  // Travels: from a few knees to what tenths of a millimetre still show.
  c.search = {{knee, 100 * knee, 12, true}, {knee / 10, 1.0001 * knee, 6, true}};
  const auto unit = [s, effect](double travel, double short_knee) {
    EffectSetting e;
    e.effect = effect;
    e.parameters[0] = {{1 / travel}, 1};
    e.parameters[1] = {{1.0}, 1};
    DriveModelConfig model = s.model;
    model.friction_knee = short_knee;
    return s.signals->response(e, model);
  };
  c.columns = [s, unit, knee](std::span<const double> theta) -> std::vector<Column> {
    Column bristle = unit(theta[0], theta[1]);
    if (bristle.empty()) return {};
    std::vector<Column> out = {std::move(bristle)};
    if (theta[1] < 0.99 * knee) {
      out.push_back(s.signals->to_rows(s.signals->direction(theta[1])));
      const Column given = s.signals->to_rows(s.signals->direction(knee));
      for (std::size_t i = 0; i < given.size(); ++i) out[1][i] -= given[i];
    }
    return out;
  };
  const EffectInfo& info = kDriveEffects[effect];
  const bool turns = s.data->turns();
  c.meaning = [info, turns, knee](std::span<const double> theta,
                                  std::span<const double> coefficients) {
    Meaning m;
    const double breakaway = coefficients[0];
    m.parameters = {{info.parameters[0].key_for(turns), {std::abs(breakaway) / theta[0]}, {}},
                    {info.parameters[1].key_for(turns), {breakaway}, {}}};
    if (!(breakaway > 0))
      m.violation =
          std::string(info.parameters[1].key_for(turns)) + " would be " + printed(breakaway, 3);
    else if (!(theta[0] > kLongerThanKnee * theta[1] && theta[0] > kOffBound * knee))
      m.violation = "its travel is that of the friction itself";
    return m;
  };
  return c;
}

constexpr double kWiderThanKnee = 2;  // less is friction, or a spring, by another law
constexpr double kLeastRatio = 0.12;  // of the load's friction to its mass, both as shares
constexpr double kLargestRatio = 4;

/// Play: width, and how much the friction of the load slows it; its share of the mass is linear.
Candidate play(std::size_t effect, const DriveSituation& s) {
  Candidate c = EffectCandidate(effect, s).make();
  const double knee = s.model.friction_knee;
  c.sized = false;
  c.search = {{knee, 300 * knee, 20, true}, {kLeastRatio, kLargestRatio, 5, true}};
  // Third: 0 for a load that is carried along after its first impact, 1 for the flanks of the
  // effect's own class, damped well enough that a record of the motor tells where the load is.
  c.search.push_back({0, 0, 1, false});
  const std::vector<SearchRange> ranges = c.search;
  c.starts = [ranges](const Column&) {
    const auto at = [](const SearchRange& r, unsigned k) {
      return r.low * std::pow(r.high / r.low, k / (r.points - 1.0));
    };
    std::vector<std::vector<double>> all;
    for (unsigned k = 0; k < ranges[0].points; ++k) {
      for (unsigned m = 0; m < ranges[1].points; ++m)
        all.push_back({at(ranges[0], k), at(ranges[1], m), 0});
      all.push_back({at(ranges[0], k), 1, 1});
    }
    return all;
  };
  const double own_share = s.model.load_inertia_share;
  c.columns = [s, effect, own_share](std::span<const double> theta) -> std::vector<Column> {
    if (theta[2] < 0.5) return {response_of_play(*s.signals, s.model, theta[0], theta[1])};
    EffectSetting e;
    e.effect = effect;
    e.parameters[0] = {{theta[0]}, 1};
    DriveModelConfig model = s.model;
    model.load_friction_share = std::min(1.0, theta[1] * own_share);
    Column column = s.signals->response(e, model);
    if (column.empty()) return {};
    for (double& x : column) x /= own_share;
    return {std::move(column)};
  };
  const char* width = kDriveEffects[effect].parameters[0].key_for(s.data->turns());
  c.meaning = [width, knee](std::span<const double> theta, std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{width, {theta[0]}, {}}};
    const double share = coefficients[0];
    if (!(share >= 0.05 && share <= 0.95))
      m.violation = "the load would have " + printed(share, 3) + " of the mass";
    else if (!(theta[0] > kWiderThanKnee * knee))
      m.violation = "its width is that of the friction's knee";
    else if (!(theta[1] > kOffBound * kLeastRatio && kOffBound * theta[1] < kLargestRatio &&
               share * theta[1] <= 1.1))
      m.violation = "the load would have " + printed(share * theta[1], 3) + " of the friction";
    return m;
  };
  return c;
}

/// Friction at even knots over the stroke; its mean belongs to Coulomb friction.
Candidate profile(std::size_t effect, const DriveSituation& s) {
  Candidate c = EffectCandidate(effect, s).make();
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

/// Power of a residual at orders low, low + step, ... of a phase [rad], usable rows.
std::vector<double> order_spectrum(const Column& residual, const std::vector<bool>& usable,
                                   const Column& phase, double low, double step, double high) {
  std::vector<double> r;
  std::vector<std::complex<double>> at, by;
  for (std::size_t i = 0; i < residual.size(); ++i) {
    if (!usable[i]) continue;
    r.push_back(residual[i]);
    at.push_back(std::polar(1.0, low * phase[i]));
    by.push_back(std::polar(1.0, step * phase[i]));
  }
  std::vector<double> power;
  for (double order = low; order <= high; order += step) {
    double re = 0, im = 0;
    for (std::size_t i = 0; i < r.size(); ++i) {
      re += r[i] * at[i].real();
      im += r[i] * at[i].imag();
      at[i] = {at[i].real() * by[i].real() - at[i].imag() * by[i].imag(),
               at[i].real() * by[i].imag() + at[i].imag() * by[i].real()};
    }
    power.push_back(re * re + im * im);
  }
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
constexpr double kLeastOfLine = 0.15;   // of what is left: less is not a line of its own
constexpr double kLeastOfFirst = 0.05;  // of the power of the first: a fifth of its amplitude

double power_of(const Column& residual, const std::vector<bool>& usable) {
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
  const auto fill = [&](std::size_t i) {
    for (std::size_t k = 0; k < orders.size(); ++k) {
      row(static_cast<Eigen::Index>(2 * k)) = std::sin(orders[k] * phase[i]);
      row(static_cast<Eigen::Index>(2 * k + 1)) = std::cos(orders[k] * phase[i]);
    }
  };
  for (std::size_t i = 0; i < residual.size(); ++i) {
    if (!usable[i]) continue;
    fill(i);
    gram += row * row.transpose();
    right += residual[i] * row;
  }
  const Eigen::VectorXd c = gram.ldlt().solve(right);
  rest = residual;
  double power = 0;
  for (std::size_t i = 0; i < residual.size(); ++i) {
    if (!usable[i]) continue;
    fill(i);
    rest[i] -= c.dot(row);
    power += rest[i] * rest[i];
  }
  return power;
}

/// Ripple: orders from the order spectrum, each with sine and cosine.
Candidate ripple(std::size_t effect, const DriveSituation& s) {
  Candidate c = EffectCandidate(effect, s).make();
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
  const double step = std::clamp(0.5 / std::max(turns, 1e-9), 0.01, 0.5);
  c.search = {{0.2, highest, 1, false, step}};
  const Column turn_phase = phase;
  const auto residual_step = step;
  c.starts = [s, turn_phase, highest, residual_step, turns](const Column& residual) {
    std::vector<std::vector<double>> all;
    if (turns < 1.5) return all;
    // A finer comb than an eighth would find the record's own beat; refinement does the rest.
    const double comb = std::max(0.125, residual_step);
    // One line after the other, each of the strongest with what it leaves.
    const auto strongest = [&](const Column& rest, std::size_t count) {
      std::vector<double> orders;
      for (const std::size_t k : highest_peaks(
               order_spectrum(rest, s.signals->usable, turn_phase, 0.5, comb, highest), count))
        orders.push_back(0.5 + comb * static_cast<double>(k));
      return orders;
    };
    for (const double order : strongest(residual, 4)) all.push_back({order});
    if (all.empty()) return all;
    std::vector<double> lines = all[0];
    Column rest;
    double left = without_lines(residual, s.signals->usable, turn_phase, lines, rest);
    const double least = kLeastOfFirst * (power_of(residual, s.signals->usable) - left);
    while (lines.size() < kMostLines) {
      const std::vector<double> next = strongest(rest, 1);
      if (next.empty()) break;
      lines.push_back(next[0]);
      const double less = without_lines(residual, s.signals->usable, turn_phase, lines, rest);
      if (!(left - less > std::max(kLeastOfLine * left, least))) break;
      all.push_back(lines);
      left = less;
    }
    return all;
  };
  const auto setting = [effect](double order, double amplitude, double phase_rad) {
    EffectSetting e;
    e.effect = effect;
    for (std::size_t p = 0; p < 3; ++p) e.parameters[p].count = 1;
    e.parameters[0].value[0] = order;
    e.parameters[1].value[0] = amplitude;
    e.parameters[2].value[0] = phase_rad;
    return e;
  };
  // One order is moved at a time: the columns of the others are kept.
  struct Line {
    double order = 0;
    Column sine, cosine;
  };
  const auto lines = std::make_shared<std::vector<Line>>();
  c.columns = [s, setting, lines](std::span<const double> theta) {
    std::vector<Column> out;
    for (const double order : theta) {
      auto line = std::find_if(lines->begin(), lines->end(),
                               [&](const Line& l) { return l.order == order; });
      if (line == lines->end()) {
        if (lines->size() > 2 * kMostLines) lines->erase(lines->begin());
        lines->push_back({order, s.signals->response(setting(order, 1, 0), s.model),
                          s.signals->response(setting(order, 1, kTwoPi / 4), s.model)});
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

constexpr double kHighestLine = 2.2;  // corners: what the filter leaves of it there still counts

/// A line fixed in time: not of the machine, but it must not be taken for something that is.
Candidate line(const DriveSituation& s) {
  Candidate c;
  c.name = "time-locked-vibration";
  c.scope = "record";
  c.where = "time";
  c.signature = "a line whose frequency no speed moves";
  c.splitting_motion = "the same move at another speed, and a standstill";
  const double corner = s.signals->corner_hz;
  const double duration = s.duration_s;
  c.search = {{1.0, kHighestLine * corner, 1, false, 0.5 / duration}};
  const double row = s.signals->row_period_s();
  c.starts = [s, corner, duration, row](const Column& residual) {
    std::size_t n = 1;
    while (n < 2 * residual.size()) n *= 2;
    std::vector<std::complex<double>> padded(n), spectrum(n);
    for (std::size_t i = 0; i < residual.size(); ++i)
      if (s.signals->usable[i]) padded[i] = residual[i];
    Eigen::FFT<double> fft;
    fft.fwd(spectrum, padded);
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

/// A share of the force that another axis exerts.
Candidate cross_talk(const DriveData::Other& other, const DriveSituation& s) {
  Candidate c;
  c.name = "cross-talk";
  c.where = "other-axis";
  c.signature = "a force that follows the motion of another axis";
  c.splitting_motion = "each axis by itself, then both together";
  Column column = s.signals->to_rows(s.signals->to_work(other.effort));
  double square = 0;
  for (const double u : column) square += u * u;
  if (!(square > 0)) {
    c.not_testable = "no other axis moves";
    c.would_need = c.splitting_motion;
  }
  c.columns = [column](std::span<const double>) { return std::vector<Column>{column}; };
  const std::string channel(servosense::name_of(other.channel));
  c.meaning = [channel](std::span<const double>, std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{"other_channel", {}, channel}, {"coefficient", {coefficients[0]}, {}}};
    return m;
  };
  return c;
}

/// The grid is walked again after each addition: its columns are kept.
Candidate remembering(Candidate c) {
  constexpr std::size_t kMost = 150;  // points
  struct Known {
    std::vector<double> theta;
    std::vector<Column> columns;
  };
  const auto known = std::make_shared<std::vector<Known>>();
  const auto columns = c.columns;
  c.columns = [known, columns](std::span<const double> theta) {
    for (const Known& k : *known)
      if (std::equal(theta.begin(), theta.end(), k.theta.begin(), k.theta.end())) return k.columns;
    std::vector<Column> made = columns(theta);
    if (known->size() < kMost) known->push_back({{theta.begin(), theta.end()}, made});
    return made;
  };
  return c;
}

}  // namespace

std::vector<Candidate> drive_candidates(const DriveSituation& s) {
  std::vector<Candidate> all;
  const DriveEffectsConfig& present = s.data->model.effects;
  for (std::size_t effect = 0; effect < kDriveEffectCount; ++effect) {
    const std::string name = kDriveEffects[effect].name;
    if (present.find(name) != nullptr) continue;
    if (name == "viscous-friction" && s.data->model.viscous > 0) continue;
    if (name == "coulomb-friction" && s.data->model.coulomb > 0) continue;
    if (name == "constant-load" && s.constant_known) continue;
    const bool timing = name == "transport-delay" || name == "current-loop-lag";
    if (timing && !s.timing_open) continue;
    Candidate c;
    if (name == "flexible-coupling")
      c = coupling(effect, s);
    else if (name == "presliding-hysteresis")
      c = presliding(effect, s);
    else if (name == "backlash")
      c = play(effect, s);
    else if (name == "position-dependent-friction")
      c = profile(effect, s);
    else if (name == "torque-ripple")
      c = ripple(effect, s);
    else
      c = EffectCandidate(effect, s).make();
    if (name == "constant-load") c.equals = {"asymmetric-friction"};
    if (name == "transport-delay") c.equals = {"current-loop-lag"};
    if (name == "current-loop-lag") c.equals = {"transport-delay"};
    if (name == "encoder-eccentricity") {
      if (!(s.model.unit_per_turn > 0)) {
        c.not_testable = "the length of a turn is not known";
        c.would_need = "lead_m in the machine file";
      } else if (!s.data->turns()) {
        c.equals = {"lead-error"};
      }
    }
    if (name == "lead-error") {
      if (!s.data->load_position.empty()) continue;  // drive_scale.hpp
      c.not_testable = "the trace has no scale on the stage";
      c.would_need = "the position of a scale, beside the counts of the motor";
    }
    c.memory = name == "presliding-hysteresis" || name == "backlash" || name == "flexible-coupling";
    all.push_back(std::move(c));
  }
  for (const DriveData::Other& other : s.data->others) all.push_back(cross_talk(other, s));
  all.push_back(line(s));
  for (Candidate& c : all) c = remembering(std::move(c));
  return all;
}

EffectSetting setting_of(const std::string& name, const Meaning& meaning, bool turns) {
  EffectSetting s;
  s.effect = drive_effect_index(name);
  if (s.effect == kDriveEffectCount) return s;
  const EffectInfo& info = kDriveEffects[s.effect];
  for (std::size_t p = 0; p < info.parameter_count(); ++p)
    for (const NamedValue& v : meaning.parameters)
      if (v.key == info.parameters[p].key_for(turns)) {
        s.parameters[p].count = std::min(v.values.size(), kMaxEffectValues);
        std::copy_n(v.values.begin(), s.parameters[p].count, s.parameters[p].value.begin());
      }
  return s;
}

}  // namespace servosense::reconcile
