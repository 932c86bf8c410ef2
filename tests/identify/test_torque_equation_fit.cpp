// Constants of the torque equation found again in noisy cuts; plans that cannot show them refused.
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/identify/torque_equation_fit.hpp"

namespace {

using namespace servosense;

constexpr double kK1 = 1.39e9, kK2 = 0.36e9, kK3 = 3160;  // steel (Bertok 1984, eq. 4.4)

TorqueCut cut_mm(double a, double b, double f, double noise = 0) {
  const double v = a * b * 1e-6, s = 10 * std::acos(1 - a / 10) * b * 1e-6, feed = f * 1e-3;
  return {v, s, feed, (kK1 * v * feed + (kK2 * feed + kK3) * s) * (1 + noise)};
}

std::vector<TorqueCut> plan(double noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> error(0, noise);
  std::vector<TorqueCut> cuts;
  for (const double a : {0.5, 1.5, 5.0, 10.0})
    for (const double f : {0.035, 0.06, 0.1}) cuts.push_back(cut_mm(a, 10, f, error(random)));
  return cuts;
}

bool refused(const std::vector<TorqueCut>& cuts, const std::string& with) {
  const auto fit = fit_torque_equation(cuts);
  return !fit && fit.error().sentence.find(with) != std::string::npos;
}

}  // namespace

int main() {
  const auto exact = fit_torque_equation(plan(0, 1));
  CHECK(exact.has_value());
  if (exact) {
    CHECK_NEAR(exact->k[0], kK1, 1e-6 * kK1);
    CHECK_NEAR(exact->k[1], kK2, 1e-6 * kK2);
    CHECK_NEAR(exact->k[2], kK3, 1e-6 * kK3);
    CHECK(exact->relative_error < 1e-9);
  }
  // Errors of 1 %: each constant within its own error as often as that says (68 %).
  constexpr int runs = 300;
  std::array<int, 3> within{};
  double relative = 0;
  int found = 0;
  for (int n = 0; n < runs; ++n) {
    const auto fit = fit_torque_equation(plan(0.01, 5200 + static_cast<std::uint64_t>(n)));
    CHECK(fit.has_value());
    if (!fit) continue;
    ++found;
    const std::array<double, 3> truth = {kK1, kK2, kK3};
    for (std::size_t k = 0; k < 3; ++k)
      within[k] += std::abs(fit->k[k] - truth[k]) < fit->standard_error[k] ? 1 : 0;
    relative += fit->relative_error / runs;
  }
  CHECK(found == runs);
  for (std::size_t k = 0; k < 3; ++k) {
    check::figure("share within a standard error", 1.0 * within[k] / runs);
    CHECK_BETWEEN(1.0 * within[k] / runs, 0.5, 0.95);
  }
  check::figure("stated error of cuts that did not teach", 100 * relative, "%");
  CHECK_BETWEEN(relative, 0.008, 0.06);

  std::vector<TorqueCut> one_feed, one_width, together, few = {cut_mm(1, 10, 0.1)};
  for (const double x : {0.5, 1.0, 2.0, 4.0, 8.0}) {
    one_feed.push_back(cut_mm(x, 10, 0.1));
    one_width.push_back(cut_mm(5, 10, 0.03 * x));
    together.push_back(x < 3 ? cut_mm(1, 10 * x, 0.05) : cut_mm(8, 10 * x, 0.1));
  }
  CHECK(refused(one_feed, "two feeds"));
  CHECK(refused(one_width, "two radial depths"));
  CHECK(refused(together, "change together"));
  CHECK(refused(few, "four cuts"));
  std::vector<TorqueCut> air = plan(0, 1);
  air.push_back({0, 0, 1e-4, 0});
  CHECK(refused(air, "leave out cuts in the air"));

  // Without a size effect the others are found as if it did not exist: none is negative.
  std::vector<TorqueCut> plain = plan(0, 1);
  std::mt19937_64 random(77);
  std::normal_distribution<double> error(0, 0.01);
  for (TorqueCut& c : plain)
    c.torque_Nm = kK1 * c.removed_m2 * c.feed_per_tooth_m * (1 + error(random));
  const auto fit = fit_torque_equation(plain);
  CHECK(fit.has_value());
  if (fit) {
    CHECK_NEAR(fit->k[0], kK1, 0.03 * kK1);
    CHECK(fit->k[1] >= 0 && fit->k[2] >= 0);
  }
  return check::done();
}
