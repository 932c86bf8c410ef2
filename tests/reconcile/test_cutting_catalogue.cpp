// Every effect of the milling catalogue that the simulator knows, hidden in the simulator: the
// workflow's own model of the cut must agree with it, name the effect, and name nothing where
// nothing is hidden. (Names against another generator: test_cutting.cpp.)
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <span>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/cutting_effects.hpp"
#include "servosense/reconcile/cutting.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

constexpr double kRate = 10000;
constexpr double kSpeed_rpm = 3000;
constexpr int kTurns = 30;  // at each feed
const std::vector<double> kFeeds = {6e-5, 1.4e-4, 9e-5};

MillingSimulation plain() {
  MillingSimulation s;
  s.tool.diameter_m = 0.012;
  s.tool.teeth = 3;
  s.tool.helix_deg = 30;
  s.tool.force.tangential_coefficient_N_per_m2 = 9e8;
  s.tool.force.radial_ratio = 0.3;
  s.cut.spindle_speed_rpm = kSpeed_rpm;
  s.cut.axial_depth_m = 0.003;
  s.cut.radial_immersion_m = 0.004;
  s.cut.direction = MillingDirection::down;
  s.trochoidal_path = true;
  s.step_s = 1e-5;
  s.layers = 24;
  return s;
}

void thin_out(reconcile::CuttingData& d, std::size_t every) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < d.time_s.size(); i += every, ++kept)
    for (reconcile::Column* column :
         {&d.time_s, &d.angle_rad, &d.feed_per_tooth_m, &d.force_x_N, &d.force_y_N})
      (*column)[kept] = (*column)[i];
  for (reconcile::Column* column :
       {&d.time_s, &d.angle_rad, &d.feed_per_tooth_m, &d.force_x_N, &d.force_y_N})
    column->resize(kept);
  d.valid.assign(kept, true);
}

/// Forces on the tool at all feeds, one after the other.
reconcile::CuttingData forces_of(MillingSimulation s) {
  reconcile::CuttingData d;
  d.channel = "tool";
  const double speed = kSpeed_rpm * kTwoPi / 60;
  const double lasts_s = kTurns * kTwoPi / speed;
  double from_s = 0;
  for (const double feed : kFeeds) {
    s.cut.feed_per_tooth_m = feed;
    auto simulator = MillingSimulator::create(s);
    CHECK(simulator.has_value());
    if (!simulator) return d;
    auto done = simulator->run(lasts_s, kRate, Decimation::average, [&](const MillingStep& sample) {
      // A mean over the period lies in its middle.
      d.time_s.push_back(from_s + sample.t_s);
      d.angle_rad.push_back((from_s + sample.t_s - 0.5 / kRate) * speed);
      d.feed_per_tooth_m.push_back(feed);
      d.force_x_N.push_back(sample.fx_N);
      d.force_y_N.push_back(sample.fy_N);
    });
    CHECK(done.has_value());
    from_s += lasts_s;
  }
  d.valid.assign(d.time_s.size(), true);
  return d;
}

double rms_between(const reconcile::CuttingData& a, const reconcile::CuttingData& b) {
  double square = 0;
  for (std::size_t i = 0; i < a.force_x_N.size(); ++i)
    square += (std::pow(a.force_x_N[i] - b.force_x_N[i], 2) +
               std::pow(a.force_y_N[i] - b.force_y_N[i], 2)) /
              2;
  return std::sqrt(square / static_cast<double>(a.force_x_N.size()));
}

/// What the owner believes: the plain tool, coefficients off.
reconcile::Report reconciled(reconcile::CuttingData d, const MillingSimulation& known,
                             double noise_N) {
  d.tool = known.tool;
  d.tool.force.tangential_coefficient_N_per_m2 *= 1.07;
  d.tool.force.radial_ratio *= 0.95;
  d.cut = known.cut;
  d.cut.feed_per_tooth_m = kFeeds[0];
  d.structure = known.structure;
  std::mt19937_64 random(11);
  std::normal_distribution<double> noise(0, noise_N);
  for (std::size_t i = 0; i < d.force_x_N.size(); ++i) {
    d.force_x_N[i] += noise(random);
    d.force_y_N[i] += noise(random);
  }
  auto outcome = reconcile::reconcile_cutting(d, {});
  CHECK(outcome.has_value());
  if (!outcome) std::printf("  %s\n", outcome.error().sentence.c_str());
  return outcome ? outcome->report : reconcile::Report{};
}

struct Hidden {
  const char* name;
  std::vector<double> values;  ///< as the catalogue's apply() takes them
  void (*apply)(std::span<const double>, MillingTool&);
};

const std::vector<Hidden> kHidden = {
    {"edge-force", {6000, 8000}, EdgeForceEffect::apply},
    {"size-effect", {0.2}, SizeEffect::apply},
    {"runout", {1e-5, 0.7}, RunoutEffect::apply},
    {"missing-tooth", {2, 0.4}, MissingToothEffect::apply},
    {"helix-lag", {40}, HelixLagEffect::apply},
    {"pitch-error", {0, 0.05, -0.03}, PitchErrorEffect::apply},
};

/// Every entry says all that a search and a report need.
void entries() {
  const std::vector<std::string> nuisances = {"angular zero", "axial depth",
                                              "damping of the structure"};
  for (const CuttingEffectInfo& info : kCuttingEffects) {
    const int before = check::failures;
    for (const char* text : {info.equation, info.channel, info.scope, info.where, info.signature,
                             info.confused_with, info.splitting_experiment})
      CHECK(text != nullptr && text[0] != '\0');
    std::stringstream others(info.confused_with);
    for (std::string other; std::getline(others, other, ',');) {
      other.erase(0, other.find_first_not_of(' '));
      other = other.substr(0, other.find(" ("));  // a condition
      CHECK(find_cutting_effect(other) != nullptr ||
            std::find(nuisances.begin(), nuisances.end(), other) != nuisances.end());
    }
    if (check::failures > before) std::printf("  %s\n", info.name);
  }
}

void each_is_found_in_its_own_data(bool all) {
  const MillingSimulation known = plain();
  const reconcile::CuttingData without = forces_of(known);
  for (const Hidden& h : kHidden) {
    // Two in every run, the rest by night.
    if (!all && std::string(h.name) != "edge-force" && std::string(h.name) != "pitch-error")
      continue;
    MillingSimulation truth = known;
    h.apply(h.values, truth.tool);
    const reconcile::CuttingData with = forces_of(truth);
    // The mean over the turns of a feed then has six times less noise than the effect is large.
    const double noise_N = rms_between(with, without) * std::sqrt(kTurns) / 6;
    const reconcile::Report r = reconciled(with, known, noise_N);
    const int before = check::failures;
    CHECK(r.effects.size() == 1);
    bool named = false;
    for (const auto& e : r.effects) {
      named = e.name == h.name;
      for (const std::string& other : e.class_members) named = named || other == h.name;
    }
    CHECK(named);
    if (check::failures > before) std::printf("  %s: %s\n", h.name, r.summary.c_str());
  }
}

/// Two models of one cut, this one integrated in time, the other over the angle: with hardly any
/// noise, what the fit leaves is what they differ by.
void simulator_and_fit_are_the_same_cut() {
  const MillingSimulation known = plain();
  const reconcile::CuttingData d = forces_of(known);
  double square = 0;
  for (std::size_t i = 0; i < d.force_x_N.size(); ++i)
    square += (d.force_x_N[i] * d.force_x_N[i] + d.force_y_N[i] * d.force_y_N[i]) / 2;
  const double force_N = std::sqrt(square / static_cast<double>(d.force_x_N.size()));
  const reconcile::Report r = reconciled(d, known, 1e-3 * force_N);
  CHECK(r.effects.empty());
  CHECK(r.verdict == reconcile::Verdict::agrees);
  check::figure("gap over the force", r.gap_after / force_N);
  // Steps turn by 3 mrad, layers lag by 12 mrad each: entries differ by some thousandths.
  CHECK(r.gap_after < 5e-3 * force_N);
}

void process_damping_is_found_where_the_structure_is_known() {
  MillingSimulation known = plain();
  known.structure.y.push_back({600, 0.04, 0.6});
  MillingSimulation truth = known;
  ProcessDampingEffect::apply(std::vector<double>{1.2e6}, truth.tool);
  const reconcile::CuttingData without = forces_of(known), with = forces_of(truth);
  const reconcile::Report r =
      reconciled(with, known, rms_between(with, without) * std::sqrt(kTurns) / 6);
  CHECK(r.effects.size() == 1);
  if (r.effects.empty()) {
    std::printf("  %s\n", r.summary.c_str());
    return;
  }
  CHECK_TEXT(r.effects[0].name, "process-damping");
  CHECK_NEAR(r.effects[0].parameters[0].values[0] / 1.2e6, 1, 0.15);
}

/// A file that says that its modes only force vibration, and a cut that remembers. Teeth that cut
/// alike leave a steady cut as a stiff tool does: that gets no name, and the report says both.
void memory_of_even_teeth_is_doubted() {
  MillingSimulation known = plain();
  known.structure.y.push_back({600, 0.04, 0.6});
  known.cut.regeneration = false;
  MillingSimulation remembers = known, stiff = known;
  remembers.cut.regeneration = true;
  stiff.structure = {};
  const reconcile::CuttingData without = forces_of(known);
  for (const MillingSimulation& truth : {remembers, stiff}) {
    const reconcile::CuttingData with = forces_of(truth);
    const double noise_N = rms_between(with, without) * std::sqrt(kTurns) / 6;
    const reconcile::Report r = reconciled(with, known, noise_N);
    CHECK(r.effects.empty());
    CHECK(r.summary.find("[structure.*] do not show") != std::string::npos);
    CHECK(std::ranges::any_of(r.not_testable, [](const reconcile::NotTestable& n) {
      return n.name == "regeneration" && n.would_need.find("tap test") != std::string::npos;
    }));
  }
}

/// Nothing is named where nothing is missing, or is not any more.
void regeneration_is_not_missed_where_it_is_not_missing() {
  MillingSimulation known = plain();
  known.structure.y.push_back({600, 0.04, 0.6});
  known.cut.regeneration = false;
  MillingSimulation truth = known;
  truth.cut.regeneration = true;
  const reconcile::CuttingData without = forces_of(known), with = forces_of(truth);
  const double noise_N = rms_between(with, without) * std::sqrt(kTurns) / 6;
  const reconcile::Report nothing = reconciled(without, known, noise_N);
  CHECK(nothing.effects.empty());
  CHECK(nothing.verdict == reconcile::Verdict::agrees);
  // Once the file remembers there is nothing to add.
  const reconcile::Report agreed = reconciled(with, truth, noise_N);
  CHECK(agreed.effects.empty());
  CHECK(agreed.verdict == reconcile::Verdict::agrees);
}

/// A recorder that filters at 0.42 of its rate, two second-order sections in small steps.
void filter_of_the_recorder_is_no_effect() {
  MillingSimulation known = plain();
  known.tool.helix_deg = 15;  // steep entries, to make it ring
  reconcile::CuttingData d = forces_of(known);
  constexpr int kEvery = 4;  // 50 samples a turn are left
  for (std::vector<double>* force : {&d.force_x_N, &d.force_y_N}) {
    double x[2] = {0, 0}, v[2] = {0, 0};
    constexpr int kSub = 8;
    const double h = 1 / kRate / kSub, w = kTwoPi * 0.42 * kRate / kEvery;
    for (double& f : *force) {
      for (int k = 0; k < kSub; ++k) {
        const double in[2] = {f, x[0]}, damping[2] = {0.92388, 0.38268};
        for (int i = 0; i < 2; ++i) {
          v[i] += h * (w * w * (in[i] - x[i]) - 2 * damping[i] * w * v[i]);
          x[i] += h * v[i];
        }
      }
      f = x[1];
    }
  }
  thin_out(d, kEvery);
  const reconcile::Report r = reconciled(d, known, 3);
  CHECK(r.effects.empty());
  CHECK(r.verdict == reconcile::Verdict::agrees);
  CHECK(std::any_of(r.remarks.begin(), r.remarks.end(), [](const std::string& remark) {
    return remark.find("filter against aliasing") != std::string::npos;
  }));
}

/// An amplifier that does not show zero without a cut: no effect, and said how much.
void offset_of_the_sensor_is_no_effect() {
  const MillingSimulation known = plain();
  reconcile::CuttingData d = forces_of(known);
  constexpr double kNoise_N = 12, kOffset_x_N = 6, kOffset_y_N = -4;
  for (double& f : d.force_x_N) f += kOffset_x_N;
  for (double& f : d.force_y_N) f += kOffset_y_N;
  const reconcile::Report r = reconciled(d, known, kNoise_N);
  CHECK(r.effects.empty());
  CHECK(r.verdict == reconcile::Verdict::agrees);
  double x = 0, y = 0;
  for (const std::string& remark : r.remarks)
    if (std::sscanf(remark.c_str(), "the sensor has an offset of %lf N along x and %lf N", &x,
                    &y) == 2)
      break;
  // 9000 samples, and cutting coefficients that are fitted beside it.
  CHECK_NEAR(x, kOffset_x_N, 5 * kNoise_N / std::sqrt(9000.0) * 2);
  CHECK_NEAR(y, kOffset_y_N, 5 * kNoise_N / std::sqrt(9000.0) * 2);
}

}  // namespace

int main(int argc, char** argv) {
  const bool all = check::nightly(argc, argv);
  entries();
  simulator_and_fit_are_the_same_cut();
  offset_of_the_sensor_is_no_effect();
  if (all) filter_of_the_recorder_is_no_effect();
  each_is_found_in_its_own_data(all);
  memory_of_even_teeth_is_doubted();
  if (all) regeneration_is_not_missed_where_it_is_not_missing();
  if (all) process_damping_is_found_where_the_structure_is_known();
  return check::done();
}
