#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <utility>

#include "reconcile/drive/backlash_response.hpp"
#include "reconcile/drive/candidates/kinds.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

// Why backlash that is hardly wider than the presliding distance has no name.
constexpr const char* kAsWideAsPresliding = "it is no wider than the presliding distance";
constexpr double kLeastRatio = 0.03;  // of the load's friction to its mass, both as shares
constexpr double kLargestRatio = 4;
constexpr unsigned kRatios = 13;                           // 1.5 apart: the least is narrow
constexpr double kLeastShare = 0.15, kLargestShare = 0.9;  // of the mass, behind the backlash
constexpr std::array<double, 3> kLoadRubs{0.7, 1.4, 2.8};  // the same ratio, behind a spring
constexpr double kStiffest = 5;  // of springs that friction winds up, to those that swing

/// Sign of motion by presliding distance: of a grid most columns come again and again.
std::function<const Column&(double)> signs_of(const DriveSituation& s) {
  return
      [s, kept = std::make_shared<std::map<double, Column>>()](double presliding) -> const Column& {
        Column& column = (*kept)[presliding];
        if (column.empty()) column = s.signals->direction_rows(presliding);
        return column;
      };
}

double on_grid(const SearchRange& r, unsigned k) {
  return r.low * std::pow(r.high / r.low, k / (r.points - 1.0));
}

}  // namespace

/// The load swings on its spring at the antiresonance, and its friction winds the spring up; its
/// share of the mass is then linear. Third: share of the friction over that of the mass. Fourth:
/// the presliding distance beside a load that rubs; alone it would have been fitted to the spring's
/// winding up.
Candidate coupling_candidate(std::size_t effect, const DriveSituation& s) {
  Candidate c = effect_candidate(effect, s);
  c.search.resize(2);
  const double presliding = s.model.friction_knee;
  const SearchRange swinging = c.search[0];  // a load without friction shows by its swing alone
  c.search[0].step = std::log(swinging.high / swinging.low) / (swinging.points - 1.0);
  const SearchRange damping = c.search[1];
  c.search[0].high *= kStiffest;
  c.search[1].step = std::log(damping.high / damping.low) / (damping.points - 1.0);
  c.search[1].high *= s.criteria->damped_by_friction;
  c.search.push_back({0, kLargestRatio, kLoadRubs.size(), false});
  c.search.push_back({presliding / 6, 1.0001 * presliding, 2, true});
  c.sized = false;
  c.starts = [ranges = c.search, swinging, damping](const Column&) {
    std::vector<std::vector<double>> all;
    for (unsigned k = 0; k < swinging.points; ++k)
      for (unsigned m = 0; m < damping.points; ++m)
        all.push_back({on_grid(swinging, k), on_grid(damping, m), 0, ranges[3].high});
    // Friction damps, too, and its winding up of the spring shows beyond the band.
    for (unsigned k = 0; k < ranges[0].points; ++k)
      for (unsigned m = 0; m < damping.points; m += 2)
        for (const double ratio : kLoadRubs)
          for (unsigned n = 0; n < ranges[3].points; ++n)
            all.push_back(
                {on_grid(ranges[0], k), on_grid(damping, m), ratio, on_grid(ranges[3], n)});
    return all;
  };
  const auto setting = [effect](std::span<const double> theta, double share) {
    const double held = std::sqrt(1 - share);
    return effect_with(effect, {theta[0] / held, std::min(1.0, theta[1] / held), share,
                                std::min(1.0, theta[2] * share)});
  };
  const auto sign = signs_of(s);
  const auto columns = [s, setting, presliding, sign](std::span<const double> theta, Rate rate) {
    std::vector<Column> out;
    const bool quicker = theta[2] > s.criteria->rubs && theta[3] < 0.99 * presliding;
    DriveModelConfig model = s.model;
    if (quicker) model.friction_knee = theta[3];
    Column column = s.signals->response(setting(theta, 1 / kLargestRatio), model, nullptr, rate);
    if (column.empty()) return out;
    for (double& v : column) v *= kLargestRatio;
    out.push_back(std::move(column));
    if (!quicker) return out;
    // Starts share their presliding distances, a refinement's are all its own: not worth keeping.
    out.push_back(
        difference(rate == Rate::working ? sign(theta[3]) : s.signals->direction_rows(theta[3]),
                   sign(presliding)));
    return out;
  };
  c.columns = [columns](std::span<const double> theta) { return columns(theta, Rate::path); };
  c.coarse_columns = [columns](std::span<const double> theta) {
    return columns(theta, Rate::working);
  };
  c.coupled = true;
  const bool turns = s.data->turns();
  const double most_damped = damping.high / s.criteria->off_bound, most_swing = damping.high;
  const double friction_per_mass = s.model.coulomb / s.model.inertia;
  c.meaning = [=, &criteria = *s.criteria, fastest = swinging.high](
                  std::span<const double> theta, std::span<const double> coefficients) {
    Meaning m;
    const double share = coefficients[0];
    m.like_bristle = theta[2] > criteria.rubs;
    const EffectSetting e = setting(theta, std::clamp(share, 0.001, 0.95));
    const std::size_t told = theta[2] > 0 ? 4 : 3;
    for (std::size_t p = 0; p < told; ++p)
      m.parameters.push_back(
          {kDriveEffects[effect].parameters[p].key_for(turns), {p == 2 ? share : e.scalar(p)}, {}});
    if (!(share >= criteria.least_load_share && share <= criteria.largest_sprung_share))
      m.violation = "the load would have " + printed(share, 3) + " of the mass";
    else if (!(share * theta[2] <= criteria.most_load_friction))
      m.violation = "the load would have " + printed(share * theta[2], 3) + " of the friction";
    else if (!(theta[0] < criteria.highest_mode_hz))
      m.violation = "sound machines have such modes";
    const bool has_limit_cycle = theta[1] < most_damped && e.scalar(1) < most_swing;
    if (m.violation.empty() &&
        !(m.like_bristle ? theta[1] < criteria.damped_by_friction * most_damped : has_limit_cycle))
      m.violation = "the load would not swing";
    // Faster than shows, it is known by its winding up, which presliding distances of other laws
    // look like.
    const double w = kTwoPi * theta[0];
    const double wound = theta[2] * friction_per_mass / (w * w * theta[3]);  // presliding distances
    const bool shows = theta[0] < fastest;
    if (m.violation.empty() && !shows && !(wound > criteria.presliding_span))
      m.violation = "it would wind up no further than the presliding distance";
    if (m.like_bristle) m.least_explained = criteria.carries_gap;
    return m;
  };
  return c;
}

/// A long bristle beside a short presliding distance. Which presliding distance is fitted too:
/// alone it would have been fitted to something between the two.
Candidate presliding_candidate(std::size_t effect, const DriveSituation& s) {
  Candidate c = effect_candidate(effect, s);
  const double presliding = s.model.friction_knee;
  // Travels: from a few presliding distances to what tenths of a millimetre still show.
  c.search = {{presliding, 100 * presliding, 12, true},
              {presliding / 10, 1.0001 * presliding, 6, true}};
  const auto bristles = std::make_shared<std::map<double, Column>>();
  const auto sign = signs_of(s);
  const auto bristle = [s, bristles](double travel) -> const Column& {
    Column& column = (*bristles)[travel];
    if (column.empty()) column = s.signals->bristle_rows(travel);
    return column;
  };
  c.columns = [bristle, sign, presliding](std::span<const double> theta) -> std::vector<Column> {
    const Column& quick = sign(theta[1]);
    std::vector<Column> out = {difference(bristle(theta[0]), quick)};
    if (theta[1] < 0.99 * presliding) out.push_back(difference(quick, sign(presliding)));
    return out;
  };
  const EffectInfo& info = kDriveEffects[effect];
  const bool turns = s.data->turns();
  c.meaning = [info, turns, presliding, &criteria = *s.criteria](
                  std::span<const double> theta, std::span<const double> coefficients) {
    Meaning m;
    const double breakaway = coefficients[0];
    m.parameters = {{info.parameters[0].key_for(turns), {std::abs(breakaway) / theta[0]}, {}},
                    {info.parameters[1].key_for(turns), {breakaway}, {}}};
    if (!(breakaway > 0))
      m.violation =
          std::string(info.parameters[1].key_for(turns)) + " would be " + printed(breakaway, 3);
    else if (!(theta[0] > criteria.longer_than_presliding * theta[1] &&
               theta[0] > criteria.off_bound * presliding))
      m.violation = "its travel is that of the friction itself";
    return m;
  };
  return c;
}

std::vector<std::vector<double>> starts_of_backlash(const std::vector<SearchRange>& ranges) {
  std::vector<std::vector<double>> all;
  for (unsigned k = 0; k < ranges[0].points; ++k) {
    const double width = on_grid(ranges[0], k);
    for (unsigned m = 0; m < ranges[1].points; ++m)
      all.push_back({width, on_grid(ranges[1], m), 0});
    all.push_back({width, 1, 1});
  }
  if (ranges.size() > 3)
    for (auto& theta : all) theta.push_back(std::sqrt(kLeastShare * kLargestShare));
  return all;
}

/// Backlash: width, and how much the friction of the load slows it; its share of the mass is
/// linear.
Candidate backlash_candidate(std::size_t effect, const DriveSituation& s) {
  Candidate c = effect_candidate(effect, s);
  const double presliding = s.model.friction_knee;
  c.sized = false;
  c.resolution = s.presliding_alone;
  c.search = {{presliding, 300 * presliding, 20, true},
              {kLeastRatio, kLargestRatio, kRatios, true}};
  // Third: 0 for a load that is carried along after its first impact, 1 for the flanks of the
  // effect's own class, damped well enough that a record of the motor tells where the load is.
  c.search.push_back({0, 0, 1, false});
  const Column loads = loads_of(*s.signals, s.acting);
  // Where something pulls at the load, its share of the mass says by how much it accelerates.
  const bool pulled = !loads.empty();
  if (pulled) c.search.push_back({kLeastShare, kLargestShare, 3, true});
  c.starts = [ranges = c.search, found = s.backlash](const Column&) {
    std::vector<std::vector<double>> all = starts_of_backlash(ranges);
    if (found.size() == ranges.size()) all.push_back(found);
    return all;
  };
  const double own_share = s.model.load_inertia_share;
  c.columns = [s, effect, own_share, loads](std::span<const double> theta) -> std::vector<Column> {
    if (theta[2] < 0.5)
      return {response_of_backlash(*s.signals, s.acting,
                                   {theta[0], theta[1], theta.size() > 3 ? theta[3] : 1}, loads)};
    DriveModelConfig model = s.model;
    model.load_friction_share = std::min(1.0, theta[1] * own_share);
    Column column = s.signals->response(effect_with(effect, {theta[0]}), model);
    if (column.empty()) return {};
    for (double& x : column) x /= own_share;
    return {std::move(column)};
  };
  const char* width = kDriveEffects[effect].parameters[0].key_for(s.data->turns());
  c.meaning = [width, presliding, &criteria = *s.criteria](std::span<const double> theta,
                                                           std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{width, {theta[0]}, {}}};
    const double share = coefficients[0];
    if (!(share >= criteria.least_load_share && share <= criteria.largest_loose_share))
      m.violation = "the load would have " + printed(share, 3) + " of the mass";
    else if (!(theta[0] > criteria.off_bound * presliding))
      m.violation = kAsWideAsPresliding;
    else if (!(criteria.off_bound * theta[1] < kLargestRatio &&
               share * theta[1] <= criteria.most_load_friction))
      m.violation = "the load would have " + printed(share * theta[1], 3) + " of the friction";
    else if (!(theta[0] > criteria.wider_than_presliding * presliding))
      m.doubt = kAsWideAsPresliding;
    return m;
  };
  return c;
}

}  // namespace servosense::reconcile
