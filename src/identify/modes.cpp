#include "servosense/identify/modes.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "modes_fit.hpp"
#include "modes_noise.hpp"
#include "modes_poles.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/usable_receptance.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using Eigen::Index;
using modes::Candidate;
using modes::Lines;
using modes::Pole;
using modes::PoleFit;

constexpr double kMostDamping = 0.5;    // more is no resonance: the response falls without a peak
constexpr double kLeastReturn = 0.5;    // of the orders from the first one on
constexpr double kMassErrors = 2;       // standard errors by which a modal mass is above nothing
constexpr double kFewestInPeak = 4;     // lines in the half-power band
constexpr double kUnsure = 0.2;         // relative standard error of damping or mass that is said
constexpr double kWellExplained = 0.9;  // of the mean square
constexpr double kWindowRules = 3;      // the window's decay over the mode's own
constexpr int kOrderOfParts = 20;       // of the highest order in a part of the band
constexpr int kMostReturns = 20;        // poles taken up again

std::string hertz(double f) { return printed(f, 5) + " Hz"; }

Expected<Lines> lines_of(const MeasuredReceptance& measured, const ModesOptions& options,
                         std::vector<std::string>& remarks) {
  FrequencyResponse in_band;
  const FrequencyResponse& all = measured.response;
  for (std::size_t k = 0; k < all.frequency_hz.size(); ++k) {
    const double f = all.frequency_hz[k];
    if (!(f > 0) || f < options.from_hz || f > options.to_hz) continue;
    in_band.frequency_hz.push_back(f);
    in_band.receptance_m_per_N.push_back(all.receptance_m_per_N[k]);
    if (!all.coherence.empty()) in_band.coherence.push_back(all.coherence[k]);
    if (!all.standard_error_m_per_N.empty())
      in_band.standard_error_m_per_N.push_back(all.standard_error_m_per_N[k]);
  }
  auto usable = usable_receptance(in_band, measured.name, measured.direct);
  if (!usable) return usable.error();
  if (!usable->remark.empty()) remarks.push_back(usable->remark);
  const auto n = static_cast<Index>(usable->lines.size());
  Lines lines{measured.name, measured.direct, all.exponential_window_per_s, {}, {}, {}};
  lines.w_rad_s.resize(n);
  lines.response.resize(n);
  Eigen::VectorXd coherence(in_band.coherence.empty() ? 0 : n);
  Eigen::VectorXd error(in_band.standard_error_m_per_N.empty() ? 0 : n);
  for (Index k = 0; k < n; ++k) {
    const auto at = static_cast<std::size_t>(k);
    lines.w_rad_s(k) = kTwoPi * usable->table.frequency_hz[at];
    lines.response(k) = usable->table.receptance_m_per_N[at];
    if (coherence.size() > 0) coherence(k) = in_band.coherence[usable->lines[at]];
    if (error.size() > 0) error(k) = in_band.standard_error_m_per_N[usable->lines[at]];
  }
  if (!(lines.response.cwiseAbs().maxCoeff() > 0))
    return data_error(measured.name + ": the receptance is zero; measure again");
  lines.noise = modes::noise_of(lines.response, coherence, error);
  return lines;
}

bool comes_back(const Candidate& c, int highest_order) {
  return c.orders >= kLeastReturn * (highest_order - c.first + 1);
}

/// Poles of halves and quarters of the band, which overlap by half.
std::vector<Pole> poles_of_parts(const std::vector<Lines>& lines, double first_rad_s,
                                 double last_rad_s, int highest_order) {
  std::vector<Pole> found;
  const int order = std::min(highest_order, kOrderOfParts);
  for (const int parts : {2, 4}) {
    const double width = (last_rad_s - first_rad_s) / parts;
    for (int i = 0; i < 2 * parts - 1; ++i) {
      const double from = first_rad_s + i * width / 2;
      std::vector<Lines> part;
      for (const Lines& l : lines)
        if (Lines some = l.between(from, from + width); some.count() >= Eigen::Index{4} * order)
          part.push_back(std::move(some));
      if (part.empty()) continue;
      auto orders = modes::poles_by_order(part, order, {});
      for (const Candidate& c : modes::candidates_of(orders))
        if (comes_back(c, order) && c.pole.w_rad_s > from && c.pole.w_rad_s < from + width)
          found.push_back(c.pole);
    }
  }
  return found;
}

/// Which of the candidates are modes: step 2 of the header. What fails is taken out, the weakest
/// first; then what was taken out, and poles of parts of the band, are tried one by one.
class Choice {
 public:
  Choice(const std::vector<Lines>& lines, std::vector<PoleTurnedDown>& turned_down)
      : lines_(lines), turned_down_(turned_down) {
    first_ = lines.front().w_rad_s(0), last_ = first_;
    double values = 0;
    for (const Lines& l : lines) {
      first_ = std::min(first_, l.w_rad_s(0));
      last_ = std::max(last_, l.w_rad_s(l.count() - 1));
      values += 2 * static_cast<double>(l.count());
    }
    // Frequency, damping, and a residue in each receptance.
    chance_ = (2 + static_cast<double>(lines.size())) * std::log(values);
  }

  /// `others`: of parts of the band, where close poles are told apart. They are tried one by one.
  PoleFit among(const std::vector<Candidate>& candidates, int highest_order,
                const std::vector<Pole>& others) {
    std::vector<Pole> poles;
    for (const Candidate& c : candidates) {
      if (const std::string fault = fault_of(c.pole); !fault.empty())
        turn_down(c.pole, fault);
      else if (!comes_back(c, highest_order))
        turn_down(c.pole, "it comes back in " + std::to_string(c.orders) + " of " +
                              std::to_string(highest_order - c.first + 1) + " orders only");
      else
        poles.push_back(c.pole);
    }
    PoleFit fit = weeded(fit_linear(lines_, poles), false);
    fit = weeded(refine(lines_, fit.poles), true);
    for (const PoleTurnedDown& t : turned_down_)
      untried_.push_back({kTwoPi * t.frequency_hz, t.damping_ratio});
    untried_.insert(untried_.end(), others.begin(), others.end());
    std::erase_if(untried_, [&](const Pole& pole) { return !fault_of(pole).empty(); });
    for (int i = 0; i < kMostReturns; ++i) {
      auto more = with_one_more(fit);
      if (!more) break;
      fit = std::move(*more);
    }
    return fit;
  }

 private:
  void turn_down(const Pole& pole, const std::string& reason) {
    turned_down_.push_back({pole.w_rad_s / kTwoPi, pole.damping, reason});
  }

  [[nodiscard]] std::string fault_of(const Pole& pole) const {
    if (pole.w_rad_s < first_ || pole.w_rad_s > last_) return "it lies outside the band";
    if (pole.damping > kMostDamping) return "it is damped too much to be a resonance";
    return "";
  }

  /// Takes out, one after the other, what is no mode; everything else is fitted again.
  PoleFit weeded(PoleFit fit, bool refined) {
    for (;;) {
      std::optional<std::size_t> out;
      std::string reason;
      for (std::size_t r = 0; r < fit.poles.size() && !out; ++r)
        if (reason = fault_of(fit.poles[r]); !reason.empty()) out = r;
      double least = chance_;
      for (std::size_t r = 0; r < fit.poles.size() && reason.empty(); ++r) {
        const double need = need_of(fit, r);
        if (need >= least) continue;
        least = need;
        out = r;
      }
      if (out && reason.empty())
        reason = "the fit does not need it: it adds no more than the fit leaves anyway";
      if (!out) {
        double lowest = kMassErrors;
        for (std::size_t r = 0; r < fit.poles.size(); ++r) {
          const double along = along_force(fit, r);
          if (along >= lowest) continue;
          lowest = along;
          out = r;
          reason = along < 0 ? "it would move against the force at the point of the force"
                             : "it hardly shows at the point of the force";
        }
      }
      if (!out) return fit;
      turn_down(fit.poles[*out], reason);
      std::vector<Pole> rest = fit.poles;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(*out));
      fit = refined ? refine(lines_, std::move(rest)) : fit_linear(lines_, std::move(rest));
    }
  }

  /// Residue at the point of the force over its standard error, the least one.
  [[nodiscard]] double along_force(const PoleFit& fit, std::size_t pole) const {
    const auto at = static_cast<Index>(pole);
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t f = 0; f < lines_.size(); ++f)
      if (lines_[f].direct)
        least = std::min(least, fit.receptances[f].values(at) /
                                    std::sqrt(fit.receptances[f].covariance(at, at)));
    return least;
  }

  /// What a pole that is not in the fit would take off its misfit is looked at: it may have been
  /// taken out while others, wrong ones, were in.
  std::optional<PoleFit> with_one_more(const PoleFit& fit) {
    auto best = untried_.end();
    double most = chance_;
    for (auto pole = untried_.begin(); pole != untried_.end(); ++pole) {
      const double gain = gain_of(lines_, fit, *pole);
      if (gain <= most) continue;
      most = gain;
      best = pole;
    }
    if (best == untried_.end()) return std::nullopt;
    const std::vector<PoleTurnedDown> before = turned_down_;
    std::vector<Pole> poles = fit.poles;
    poles.push_back(*best);
    std::erase_if(turned_down_, [&](const PoleTurnedDown& t) {
      return kTwoPi * t.frequency_hz == best->w_rad_s;
    });
    untried_.erase(best);
    PoleFit more = weeded(refine(lines_, std::move(poles)), true);
    if (more.poles.size() > fit.poles.size() ||
        (more.poles.size() == fit.poles.size() && misfit_fell(fit, more)))
      return more;
    turned_down_ = before;
    return fit;
  }

  [[nodiscard]] bool misfit_fell(const PoleFit& from, const PoleFit& to) const {
    double fall = 0;
    for (std::size_t f = 0; f < lines_.size(); ++f)
      fall += (from.receptances[f].rest.squaredNorm() - to.receptances[f].rest.squaredNorm()) /
              from.receptances[f].scale();
    return fall > chance_;
  }

  const std::vector<Lines>& lines_;
  std::vector<PoleTurnedDown>& turned_down_;
  std::vector<Pole> untried_;
  double first_ = 0, last_ = 0;
  double chance_ = 0;
};

/// Median distance of lines in the finest receptance.
double finest_step_hz(const std::vector<Lines>& lines) {
  double finest = std::numeric_limits<double>::infinity();
  for (const Lines& l : lines) {
    std::vector<double> steps;
    for (Index k = 1; k < l.count(); ++k)
      steps.push_back((l.w_rad_s(k) - l.w_rad_s(k - 1)) / kTwoPi);
    const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    finest = std::min(finest, *middle);
  }
  return finest;
}

std::string doubt_of(const IdentifiedMode& mode, const std::vector<Lines>& lines) {
  const double f = mode.natural_frequency_hz.value, zeta = mode.damping_ratio.value;
  double lowest = std::numeric_limits<double>::infinity(), highest = 0, window = 0;
  for (const Lines& l : lines) {
    lowest = std::min(lowest, l.w_rad_s(0) / kTwoPi);
    highest = std::max(highest, l.w_rad_s(l.count() - 1) / kTwoPi);
    window = std::max(window, l.decay_per_s);
  }
  if (mode.lines_in_peak < kFewestInPeak)
    return "its half-power band has " + printed(mode.lines_in_peak, 2) +
           " lines, and damping and mass hang on them; record longer";
  if (f - zeta * f < lowest || f + zeta * f > highest)
    return "its peak is cut by the end of the band; measure a wider one";
  if (window > kWindowRules * zeta * kTwoPi * f)
    return "the exponential window damps it " + printed(window / (zeta * kTwoPi * f), 2) +
           " times as much as it damps itself; record longer, with less window";
  for (const auto& [estimate, what] :
       {std::pair{&mode.damping_ratio, "damping"}, std::pair{&mode.modal_mass_kg, "mass"}})
    if (estimate->standard_error > kUnsure * estimate->value)
      return std::string("its ") + what + " is known within " +
             printed(100 * estimate->standard_error / estimate->value, 2) + " % only";
  return "";
}

Estimate at(const modes::LinearFit& fit, Index i) {
  return {fit.values(i), std::sqrt(fit.covariance(i, i))};
}

/// From the residues at the point of the force, each by its accuracy.
Estimate modal_mass(const PoleFit& fit, const std::vector<Lines>& lines, Index pole) {
  double weights = 0, sum = 0;
  for (std::size_t f = 0; f < lines.size(); ++f) {
    if (!lines[f].direct) continue;
    const double weight = 1 / fit.receptances[f].covariance(pole, pole);
    weights += weight;
    sum += weight * fit.receptances[f].values(pole);
  }
  const double none = std::numeric_limits<double>::quiet_NaN();
  if (!(weights > 0)) return {none, none};
  const double residue = sum / weights;
  return {1 / residue, 1 / std::sqrt(weights) / (residue * residue)};
}

FittedReceptance fitted(const Lines& l, const PoleFit& fit, std::size_t f) {
  FittedReceptance result{l.name, l.direct, {}, {}, {}, {}, {}, 0};
  const Eigen::VectorXcd model = fitted_response(l, fit, f);
  for (Index k = 0; k < l.count(); ++k) {
    result.frequency_hz.push_back(l.w_rad_s(k) / kTwoPi);
    result.measured_m_per_N.push_back(l.response(k));
    result.fitted_m_per_N.push_back(model(k));
  }
  const auto n = static_cast<Index>(fit.poles.size());
  result.compliance_m_per_N = at(fit.receptances[f], n);
  result.inverse_mass_per_kg = at(fit.receptances[f], n + 1);
  result.explained = 1 - (l.response - model).squaredNorm() / l.response.squaredNorm();
  return result;
}

std::string names_of(const std::vector<Lines>& lines) {
  return lines.front().name + (lines.size() > 1 ? " and others" : "");
}

}  // namespace

Expected<ModesIdentification> identify_modes(const std::vector<MeasuredReceptance>& receptances,
                                             const ModesOptions& options) {
  if (receptances.empty()) return usage_error("give one receptance or more");
  ModesIdentification found;
  std::vector<Lines> lines;
  // What spoils the bottom of a receptance at the point of the force, where it shows, spoils that
  // of the others too.
  ModesOptions band = options;
  for (const bool direct : {true, false})
    for (const MeasuredReceptance& measured : receptances) {
      if (measured.direct != direct) continue;
      auto l = lines_of(measured, band, found.remarks);
      if (!l) return l.error();
      if (direct) band.from_hz = std::max(options.from_hz, l->w_rad_s(0) / kTwoPi);
      lines.push_back(std::move(*l));
    }
  Index most = 0;
  double first = lines.front().w_rad_s(0), last = first;
  for (const Lines& l : lines) {
    most = std::max(most, l.count());
    first = std::min(first, l.w_rad_s(0));
    last = std::max(last, l.w_rad_s(l.count() - 1));
  }
  // Of each order two numbers are fitted to each line: leave twice as many lines.
  const int highest = std::clamp(options.highest_order, 4, std::max(4, static_cast<int>(most / 4)));
  auto orders = modes::poles_by_order(lines, highest, options.progress);
  const std::vector<Candidate> candidates = modes::candidates_of(orders);
  for (const modes::OrderPoles& at_order : orders)
    for (std::size_t i = 0; i < at_order.poles.size(); ++i)
      found.diagram.push_back({at_order.order, at_order.poles[i].w_rad_s / kTwoPi,
                               at_order.poles[i].damping, at_order.stable[i]});
  const PoleFit fit = Choice(lines, found.turned_down)
                          .among(candidates, highest, poles_of_parts(lines, first, last, highest));
  std::sort(found.turned_down.begin(), found.turned_down.end(),
            [](const auto& l, const auto& r) { return l.frequency_hz < r.frequency_hz; });
  if (fit.poles.empty())
    return data_error(
        names_of(lines) + ": no mode is found between " + hertz(lines.front().w_rad_s(0) / kTwoPi) +
        " and " + hertz(lines.front().w_rad_s(lines.front().count() - 1) / kTwoPi) +
        ": no peak stands out of the noise; hit harder, average more hits, or measure "
        "another band");
  const double step_hz = finest_step_hz(lines);
  double window = 0;
  for (const Lines& l : lines) window = std::max(window, l.decay_per_s);
  for (std::size_t r = 0; r < fit.poles.size(); ++r) {
    const Pole& pole = fit.poles[r];
    const auto i = static_cast<Index>(r);
    IdentifiedMode mode;
    const double f = pole.w_rad_s / kTwoPi;
    mode.natural_frequency_hz = {f, f * std::sqrt(fit.covariance(2 * i, 2 * i))};
    mode.damping_ratio = {pole.damping,
                          pole.damping * std::sqrt(fit.covariance(2 * i + 1, 2 * i + 1))};
    mode.modal_mass_kg = modal_mass(fit, lines, i);
    for (const modes::LinearFit& l : fit.receptances) mode.residue_per_kg.push_back(at(l, i));
    mode.lines_in_peak = 2 * (pole.damping * f + window / kTwoPi) / step_hz;
    mode.doubt = doubt_of(mode, lines);
    found.modes.push_back(std::move(mode));
  }
  std::sort(found.modes.begin(), found.modes.end(), [](const auto& l, const auto& r) {
    return l.natural_frequency_hz.value < r.natural_frequency_hz.value;
  });
  for (std::size_t f = 0; f < lines.size(); ++f) {
    found.receptances.push_back(fitted(lines[f], fit, f));
    const FittedReceptance& done = found.receptances.back();
    if (done.explained < kWellExplained)
      found.remarks.push_back(done.name + ": the modes explain " +
                              printed(100 * std::max(0.0, done.explained), 2) +
                              " % of the receptance only; the rest is noise, or modes that were "
                              "not told apart");
  }
  return found;
}

}  // namespace servosense
