// Engagement along a workpiece: Tarng's cases (1988, App. B) and a point-by-point search.
#include <algorithm>
#include <cmath>
#include <random>

#include "check.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

constexpr double kR = 50.8e-3, kW = 0.2;

std::vector<Engagement> arcs(double immersion, MillingDirection direction, double penetration) {
  MillingTool tool;
  tool.diameter_m = 2 * kR;
  MillingCut cut;
  cut.radial_immersion_m = immersion * 2 * kR;
  cut.direction = direction;
  Workpiece block;
  block.length_m = kW;
  return engagement_arcs(block, kR, engagement_of(tool, cut), penetration - kR);
}

void one_arc(const std::vector<Engagement>& found, double start, double exit) {
  CHECK(found.size() == 1);
  if (found.size() != 1) return;
  CHECK_NEAR(found[0].start_rad, start, 1e-12);
  CHECK_NEAR(found[0].exit_rad, exit, 1e-12);
}

// L is the penetration of the cutter's leading edge.
void entry_steady_exit() {
  const auto up = MillingDirection::up, down = MillingDirection::down;
  const auto slot = MillingDirection::slot;
  for (const double share : {0.02, 0.3, 0.7, 0.99}) {
    const double in = share * kR, out = kW + share * kR;
    const double alpha = std::asin(1 - share), beta = std::acos(1 - share);
    one_arc(arcs(0.5, up, in), alpha, kPi / 2);
    one_arc(arcs(0.5, down, in), kPi / 2, kPi - alpha);
    one_arc(arcs(0.5, up, out), 0, kPi / 2 - beta);
    one_arc(arcs(0.5, down, out), kPi / 2 + beta, kPi);
    one_arc(arcs(1, slot, in), kPi / 2 - beta, kPi / 2 + beta);
    const auto leaving = arcs(1, slot, out);
    CHECK(leaving.size() == 2);
    if (leaving.size() != 2) continue;
    CHECK_NEAR(leaving[0].start_rad, 0, 1e-12);
    CHECK_NEAR(leaving[0].exit_rad, kPi / 2 - beta, 1e-12);
    CHECK_NEAR(leaving[1].start_rad, kPi / 2 + beta, 1e-12);
    CHECK_NEAR(leaving[1].exit_rad, kPi, 1e-12);
  }
  // Small immersions touch S_L behind the leading edge.
  const double quarter = kR * (2 - std::sqrt(3.0)) / 2, eighth = kR * (4 - std::sqrt(7.0)) / 4;
  for (const auto direction : {up, down}) {
    for (const auto& [immersion, offset] : {std::pair{0.25, quarter}, {0.125, eighth}}) {
      CHECK(arcs(immersion, direction, offset - 1e-6).empty());
      CHECK(!arcs(immersion, direction, offset + 1e-6).empty());
      CHECK_NEAR(arcs(immersion, direction, kW + offset - 1e-6)[0].swept_rad(),
                 std::acos(1 - 2 * immersion), 1e-12);
      CHECK(arcs(immersion, direction, kW + offset + 1e-6)[0].swept_rad() <
            std::acos(1 - 2 * immersion));
      MillingTool tool;
      tool.diameter_m = 2 * kR;
      const MillingCut cut{600, 1e-4, 1e-3, immersion * 2 * kR, direction};
      CHECK_NEAR(first_contact_m(kR, engagement_of(tool, cut)), offset - kR, 1e-12);
    }
  }
  for (const double penetration : {kW + kR * 1.000001, kW + 3 * kR, 1e3, -1e-9, -1.0})
    CHECK(arcs(1, slot, penetration).empty());  // no end of the domain either way
}

// Any mixture of faces, slots and holes: a tip is engaged where its point lies in material.
void point_by_point() {
  for (const unsigned seed : {1u, 2u, 3u, 4u, 5u}) {
    const int failures_before = check::failures;
    std::mt19937 random(seed);
    const auto draw = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    Workpiece w;
    w.length_m = kW;
    for (int i = 0; i < 2; ++i) {
      const double from = draw(0, kW);
      w.slots.push_back({from, from + draw(0.001, 0.03)});
      w.holes.push_back({draw(0, kW), draw(-kR, kR), draw(0.002, 0.06)});
    }
    for (int i = 0; i < 60; ++i) {
      const double x = draw(-kR, kW + kR);
      const auto found = engagement_arcs(w, kR, {0, kPi}, x);
      int wrong = 0;
      for (int k = 0; k < 1000; ++k) {
        const double theta = kPi * (k + 0.5) / 1000;
        const double px = x + kR * std::sin(theta), py = kR * std::cos(theta);
        bool material = px >= 0 && px <= kW;
        for (const auto& s : w.slots) material = material && !(px > s.from_m && px < s.to_m);
        for (const auto& h : w.holes)
          material = material && std::hypot(px - h.x_m, py - h.y_m) >= h.radius_m;
        bool inside = false;
        for (const auto& arc : found)
          inside = inside || (theta >= arc.start_rad && theta <= arc.exit_rad);
        wrong += inside != material;
      }
      CHECK(wrong == 0);
    }
    if (check::failures > failures_before) std::cout << "  seed " << seed << '\n';
  }
}

// Entry and exit of an intact cut, difference per tooth average from nine samples a tooth period:
// 60.7 / 52.7 N at half immersion, 120.5 / 120.3 N in a slot (reference values of Tarng 1988).
void entry_and_exit_forces() {
  struct Case {
    double immersion, entry, exit;
  };
  for (const Case& c : {Case{0.5, 60.7, 52.7}, Case{1, 120.5, 120.3}}) {
    MillingSimulation s;
    s.tool.diameter_m = 2 * kR;
    s.tool.teeth = 8;
    s.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
    s.tool.force.radial_ratio = 0.5263;
    s.cut = {600, 0.254e-3, 1.27e-3, c.immersion * 2 * kR,
             c.immersion == 1 ? MillingDirection::slot : MillingDirection::up};
    s.workpiece.length_m = 0.1;
    s.start = MillingStart::entry;
    s.step_s = 0.0125 / 99;
    auto simulator = MillingSimulator::create(s);
    CHECK(simulator.has_value());
    if (!simulator) continue;
    double before = 0, entry = 0, exit = 0;
    const int periods = static_cast<int>((0.1 + 2.2 * kR) / 0.254e-3);
    for (int j = 0; j < periods; ++j) {
      double fx = 0, fy = 0;
      for (int i = 0; i < 99; ++i) {
        const MillingStep& n = simulator->step();
        if (i % 11 != 5) continue;  // nine samples a tooth period, in the middle of their bins
        fx += n.fx_N / 9;
        fy += n.fy_N / 9;
      }
      const double average = std::hypot(fx, fy);
      double& side = simulator->now().feed_m < 0.05 ? entry : exit;
      side = std::max(side, std::abs(average - before));
      before = average;
    }
    CHECK_NEAR(before, 0, 1e-12);  // out of the work again
    check::figure("entry, largest difference of tooth averages", entry, "N");
    check::figure("exit", exit, "N");
    CHECK_NEAR(entry, c.entry, 0.01 * c.entry);
    // That of a slot depends on the length of the work: test_sim milling_slot_exit.
    if (c.immersion < 1) CHECK_NEAR(exit, c.exit, 0.01 * c.exit);
  }
}

}  // namespace

int main() {
  entry_steady_exit();
  point_by_point();
  entry_and_exit_forces();
  return check::done();
}
