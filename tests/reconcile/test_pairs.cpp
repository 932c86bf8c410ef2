// Two effects that are missing at once, as columns made by formulas: of like size, so that either
// may fit better alone; and a level beside a bell of speed that takes part of it.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "check.hpp"
#include "servosense/reconcile/decide.hpp"

using namespace servosense::reconcile;

namespace {

constexpr std::size_t kRows = 3000;

/// Noise of 1 beside a known term; the last third is held out.
Problem problem() {
  Problem p;
  p.unit = "N";
  p.row_period_s = 5e-3;
  p.noise_bandwidth_hz = 70;
  p.usable.assign(kRows, true);
  std::mt19937_64 random(5);
  std::normal_distribution<double> noise;
  KnownTerm known;
  known.name = "known";
  for (std::size_t i = 0; i < kRows; ++i) {
    p.time_s.push_back(5e-3 * static_cast<double>(i));
    p.held_out.push_back(i >= 2 * kRows / 3);
    known.column.push_back(std::cos(0.37 * static_cast<double>(i)));
    p.target.push_back(30 * known.column.back() + noise(random));
  }
  p.known.push_back(known);
  return p;
}

Candidate candidate(const char* name, std::function<double(double, std::size_t)> shape,
                    std::vector<SearchRange> search = {}) {
  Candidate c;
  c.name = name;
  c.search = std::move(search);
  c.columns = [shape](std::span<const double> theta) {
    Column column(kRows);
    for (std::size_t i = 0; i < kRows; ++i) column[i] = shape(theta.empty() ? 0 : theta[0], i);
    return std::vector<Column>{column};
  };
  c.meaning = [](std::span<const double>, std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{"size", {coefficients[0]}, {}}};
    return m;
  };
  return c;
}

bool named(const Decision& d, const std::vector<Candidate>& all, const std::string& name) {
  return std::any_of(d.accepted.begin(), d.accepted.end(),
                     [&](const Accepted& a) { return all[a.candidate].name == name; });
}

void of_like_size() {
  Problem p = problem();
  // Each shows in few blocks of the record: which of them resampled data hold more of is chance.
  const auto within = [](std::size_t i, std::size_t part) {
    return i / 83 % 12 == part ? std::sin(0.3 * static_cast<double>(i)) : 0.0;
  };
  const auto left = [=](double, std::size_t i) { return within(i, 2); };
  const auto right = [=](double, std::size_t i) { return within(i, 8); };
  for (std::size_t i = 0; i < kRows; ++i) p.target[i] += 40 * left(0, i) + 34 * right(0, i);
  const std::vector<Candidate> all = {candidate("left", left), candidate("right", right)};
  const Decision d = decide(p, all, {});
  CHECK(named(d, all, "left") && named(d, all, "right"));
  // What is left of the gap is the noise.
  CHECK_NEAR(d.report.gap_after, 1, 0.1);
  CHECK_NEAR(std::sqrt(d.loss), 1, 0.1);
}

void one_stands_for_both() {
  Problem p = problem();
  const auto speed = [](std::size_t i) {
    return std::abs(std::sin(0.0203 * static_cast<double>(i)));
  };
  const auto sign = [](std::size_t i) {
    return std::sin(0.0203 * static_cast<double>(i)) < 0 ? -1.0 : 1.0;
  };
  // A bell of speed and a level: with a width of its own the bell takes most of the level.
  const auto bell = [=](double width, std::size_t i) {
    return sign(i) * std::exp(-std::pow(speed(i) / width, 2));
  };
  const auto level = [=](double, std::size_t i) { return sign(i); };
  for (std::size_t i = 0; i < kRows; ++i) p.target[i] += 40 * bell(0.15, i) + 80 * level(0, i);
  const std::vector<Candidate> all = {candidate("bell", bell, {{0.02, 0.8, 14}}),
                                      candidate("level", level)};
  const Decision d = decide(p, all, {});
  CHECK(named(d, all, "bell") && named(d, all, "level"));
  for (const Accepted& a : d.accepted)
    if (all[a.candidate].name == "bell") CHECK_NEAR(a.theta[0], 0.15, 0.01);
  CHECK_NEAR(d.report.gap_after, 1, 0.1);
}

/// A load beside a second effect that grows along the axis. Alone a spring takes a part of that one
/// too; beside it the rest of the spring would be far beyond the axis, and the load is what it was.
void a_spring_that_was_a_load() {
  Problem p = problem();
  const auto place = [](std::size_t i) { return std::sin(0.0203 * static_cast<double>(i)); };
  const auto other = [=](double, std::size_t i) {
    return 0.6 * place(i) + std::sin(0.31 * static_cast<double>(i));
  };
  const auto load = [](double, std::size_t) { return 1.0; };
  for (std::size_t i = 0; i < kRows; ++i) p.target[i] += 30 + 12 * other(0, i);
  Candidate spring = candidate("spring", load);
  spring.columns = [=](std::span<const double>) {
    std::vector<Column> both(2, Column(kRows, 1));
    for (std::size_t i = 0; i < kRows; ++i) both[0][i] = place(i);
    return both;
  };
  spring.meaning = [](std::span<const double>, std::span<const double> coefficients) {
    const double rest = -coefficients[1] / coefficients[0];
    return Meaning{{{"rest", {rest}, {}}}, std::abs(rest) < 10 ? "" : "beyond the axis"};
  };
  const std::vector<Candidate> all = {candidate("other", other), candidate("load", load), spring};
  const Decision d = decide(p, all, {});
  CHECK(named(d, all, "load") && named(d, all, "other") && !named(d, all, "spring"));
  CHECK_NEAR(d.report.gap_after, 1, 0.1);
}

/// Neither is there: no name.
void none() {
  const std::vector<Candidate> all = {
      candidate("level", [](double, std::size_t i) { return i / 83 % 2 == 0 ? 1.0 : -1.0; }),
      candidate("sine",
                [](double, std::size_t i) { return std::sin(0.02 * static_cast<double>(i)); })};
  CHECK(decide(problem(), all, {}).accepted.empty());
}

}  // namespace

int main() {
  of_like_size();
  one_stands_for_both();
  a_spring_that_was_a_load();
  none();
  return check::done();
}
