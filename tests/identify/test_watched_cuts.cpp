// What cuts teach: against an integration in time that labels them (milling_machines.hpp), and
// against what Bayes' rule says by plain importance weights. --nightly: machines without a hammer.
#include <cmath>
#include <memory>
#include <mutex>
#include <sstream>

#include "check.hpp"
#include "io/malformed.hpp"
#include "milling_machines.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/identify/watched_cuts.hpp"
#include "servosense/sim/run_parallel.hpp"

using namespace servosense;
using namespace milling_machines;

namespace {

Machine shop_machine() {
  return half_immersed({{{820, 0.04, 0.35}}, {{870, 0.035, 0.4}}}, {5000, 14000, 1e-4, 0.03});
}

CutErrors without_hammer() {
  CutErrors e;
  e.tangential = 0.04;
  e.radial_ratio = 0.05;
  e.offset_m = 0;
  return e;
}

/// A cut as the machine does it, its chatter heard to 0.3 %.
WatchedCut done(const oracle::RegenerativeCut& truth, double rpm, double depth_m, Chance& chance) {
  WatchedCut cut;
  cut.spindle_speed_rpm = rpm;
  cut.axial_depth_m = depth_m;
  double hz = 0;
  cut.stable = oracle::growth_per_tooth(truth, rpm, depth_m, 160, 24, &hz) < 0;
  if (!cut.stable) cut.chatter_hz = hz * (1 + 0.003 * chance.normal());
  return cut;
}

void files() {
  malformed::check_all("watched_cuts", 7, [](const std::string& path) {
    const auto cuts = read_watched_cuts(path);
    return cuts ? Error{ErrorKind::data, ""} : cuts.error();
  });
  const auto cuts = read_watched_cuts(
      std::make_unique<std::istringstream>(
          "{\"spindle_speed_rpm\": 8000, \"axial_depth_m\": 2e-3, \"stable\": false, "
          "\"chatter_hz\": 950.5, \"note\": \"loud\"}\n\n"
          "{\"stable\": true, \"axial_depth_m\": 0.001, \"spindle_speed_rpm\": 7e3, "
          "\"chatter_hz\": null, \"radial_immersion_m\": 0.004, \"direction\": \"up\"}\n"),
      "cuts");
  CHECK(cuts && cuts->size() == 2);
  if (!cuts) return;
  CHECK(!(*cuts)[0].stable && (*cuts)[0].chatter_hz == 950.5 && !(*cuts)[0].radial_immersion_m);
  CHECK((*cuts)[1].stable && !(*cuts)[1].chatter_hz && (*cuts)[1].direction == "up");
  CHECK((*cuts)[1].radial_immersion_m == 0.004 && (*cuts)[1].spindle_speed_rpm == 7000);
}

/// Two cuts on narrow errors: the sampler against weights of 4000 independent samples.
void as_bayes_says() {
  const Machine m = shop_machine();
  CutErrors e = without_hammer();
  e.x = e.y = {{0.01, 0.1, 0.1}};
  const auto cut = UncertainCut::create(m.structure, m.tool, m.cut, e);
  CHECK(cut.has_value());
  WatchedCut first{9000, 0.0016, false, {}, {}, {}}, second{8000, 0.0014, true, {}, {}, {}};
  WatchedCutsConfig config;
  config.samples = 600;
  const std::vector<WatchedCut> cuts = {first, second};
  const auto learned = learn_from_cuts(*cut, cuts, config);
  CHECK(learned.has_value());
  if (!learned) return;
  CHECK(learned->least_effective_share >= 0.5 && learned->belief.cols() == 600);
  constexpr std::size_t kSamples = 4000;
  std::vector<double> weight(kSamples);
  Eigen::MatrixXd z(cut->size(), kSamples);
  Chance chance(77);
  for (double& x : z.reshaped()) x = chance.normal();
  run_parallel(kSamples, [&](std::size_t s) {
    const auto p = cut->at(z.col(static_cast<Eigen::Index>(s)));
    const auto sd = SemiDiscretization::create(p.structure, p.tool, m.cut);
    weight[s] = 1;
    for (const WatchedCut& w : cuts) {
      const double growth = std::log(sd->spectral_radius(w.spindle_speed_rpm, w.axial_depth_m));
      const double chatter = 0.02 + 0.96 / (1 + std::exp(-growth / 0.01));
      weight[s] *= w.stable ? 1 - chatter : chatter;
    }
  });
  double all = 0, squares = 0;
  for (const double w : weight) all += w, squares += w * w;
  for (Eigen::Index i = 0; i < cut->size(); ++i) {
    double mean = 0;
    for (std::size_t s = 0; s < kSamples; ++s)
      mean += weight[s] * z(i, static_cast<Eigen::Index>(s)) / all;
    // Four standard errors of both together, each sample of unit variance at most.
    const double error = std::sqrt(squares / (all * all) + 2.0 / 600);
    CHECK_NEAR(learned->belief.row(i).mean(), mean, 4 * error);
  }
}

/// One cut that chatters tells the frequency; notes that contradict each other are named.
void what_is_told() {
  const Machine m = shop_machine();
  const auto cut = UncertainCut::without_structure(m.tool, m.cut, without_hammer());
  CHECK(cut.has_value());
  const auto truth = judged(m.structure, m.tool, m.cut);
  Chance chance(5);
  WatchedCutsConfig config;
  config.samples = 200;
  const std::vector<WatchedCut> one = {done(truth, 9000, 0.004, chance)};
  CHECK(!one[0].stable && one[0].chatter_hz > 700 && one[0].chatter_hz < 1200);
  const auto learned = learn_from_cuts(*cut, one, config);
  CHECK(learned.has_value());
  if (!learned) return;
  double mean = 0, square = 0;
  for (Eigen::Index s = 0; s < learned->belief.cols(); ++s) {
    const double f =
        std::log(cut->at(learned->belief.col(s)).structure.y[0].natural_frequency_hz / 845);
    mean += f / 200, square += f * f / 200;
  }
  check::figure("frequency after one cut, off", 100 * mean, "%");
  check::figure("  standard deviation (60 % before)", 100 * std::sqrt(square - mean * mean), "%");
  CHECK(std::sqrt(square) < 0.25);
  // Stable deep beside chatter shallow at one speed: the second note is not believed.
  std::vector<WatchedCut> odd = one;
  for (int i = 0; i < 3; ++i) odd.push_back({9000, 0.004, false, {}, {}, {}});
  odd.push_back({9000, 0.006, true, {}, {}, {}});
  const auto doubtful = learn_from_cuts(*cut, odd, config);
  CHECK(doubtful.has_value());
  if (doubtful) CHECK(doubtful->chatter_probability.back() > 0.9);
  odd[0].radial_immersion_m = 1;  // wider than the tool
  CHECK(!learn_from_cuts(*cut, odd, config).has_value());
}

struct Shop {
  double said_m = 0, is_m = 0, share = 0;
  bool stable = true;
};

/// Twenty cuts, each where the program would have it: the test cut that gains most, and from the
/// sixth on the best pocket by the middle of what is believed.
Shop twenty_cuts(std::uint64_t seed) {
  Chance chance(seed);
  const Machine truth = random_machine(chance, false);
  CutErrors errors;
  Machine seen = believed(truth, chance, errors);
  errors.x.clear(), errors.y.clear();
  const auto cut = UncertainCut::without_structure(seen.tool, seen.cut, errors);
  const auto own = judged(truth.structure, truth.tool, truth.cut);
  RecommendConfig config;
  config.threads = 1;
  config.speeds = 60;
  config.map_samples = 100;
  std::vector<WatchedCut> cuts;
  CutBelief belief = prior_belief(*cut, 400, seed);
  for (;;) {
    const auto found = recommend_cut(*cut, belief, seen.limits, config);
    const auto middle = [&](std::size_t i) {
      const auto row = found->limit_depth_m.row(static_cast<Eigen::Index>(i));
      return std::min(row[row.size() / 2], seen.limits.axial_depth_m);
    };
    std::size_t best = 0;
    const auto& rpm = found->spindle_speed_rpm;
    for (std::size_t i = 0; i < rpm.size(); ++i)
      if (middle(i) * rpm[i] > middle(best) * rpm[best]) best = i;
    if (cuts.size() >= 20) {
      Shop shop;
      shop.said_m = middle(best);
      shop.is_m = limit_by_integration(own, rpm[best], truth.limits.axial_depth_m, shop.said_m);
      if (found->cut) {
        shop.share = found->cut->axial_depth_m * found->cut->spindle_speed_rpm /
                     best_by_integration(truth, shop.said_m);
        shop.stable = oracle::growth_per_tooth(own, found->cut->spindle_speed_rpm,
                                               found->cut->axial_depth_m, 300, 30) < 0;
      }
      return shop;
    }
    if (found->next_cut)
      cuts.push_back(
          done(own, found->next_cut->spindle_speed_rpm, found->next_cut->axial_depth_m, chance));
    if (!found->next_cut || cuts.size() >= 6)
      cuts.push_back(done(own, rpm[best], middle(best), chance));
    WatchedCutsConfig learning;
    learning.threads = 1;
    learning.samples = cuts.size() >= 20 ? 400 : 200;
    learning.seed = seed;
    belief = learn_from_cuts(*cut, cuts, learning)->belief;
  }
}

void without_a_hammer(std::uint64_t seed, std::size_t count) {
  std::mutex counting;
  int within = 0, stable = 0;
  double share = 0;
  run_parallel(count, [&](std::size_t i) {
    const Shop shop = twenty_cuts(1000 * seed + i);
    const std::lock_guard lock(counting);
    within += std::abs(shop.said_m / shop.is_m - 1) <= 0.15;
    stable += shop.stable;
    share += shop.share;
    std::printf("  said %.3f mm, is %.3f mm\n", 1e3 * shop.said_m, 1e3 * shop.is_m);
  });
  const auto all = static_cast<double>(count);
  check::figure("best pocket within 15 % after 20 cuts", 100 * within / all, "% of machines");
  check::figure("  advised cut stable", 100 * stable / all, "%");
  check::figure("  removal, of what full knowledge would", 100 * share / all, "%");
  CHECK(within >= 0.8 * all);
  CHECK(stable >= 0.85 * all);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3) {  // SEED COUNT: other machines
    without_a_hammer(std::strtoull(argv[1], nullptr, 10), std::strtoull(argv[2], nullptr, 10));
    return check::done();
  }
  files();
  as_bayes_says();
  what_is_told();
  if (check::nightly(argc, argv)) without_a_hammer(412, 24);
  return check::done();
}
