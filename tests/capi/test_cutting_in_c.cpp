// The cutting coefficients through the C interface, on milled programs of a generator of its own
// (tests/monitors/milled_program.hpp): what is found, a change, a deeper cut of which the stack is
// told, wear; what is refused.
#include <array>
#include <cmath>
#include <cstring>
#include <memory>

#include "check.hpp"
#include "monitors/milled_program.hpp"
#include "servosense/capi/machine_config.hpp"

namespace {

using namespace servosense;

const char* const kMachine =
    "[machine]\nsample_rate_hz = 8000\n"
    "[spindle]\ninertia_kg_m2 = 0.001\n[axis.x]\nequivalent_mass_kg = 50\n"
    "[axis.y]\nequivalent_mass_kg = 50\n"
    "[monitor.chatter]\nenabled = no\n"
    "[monitor.collision]\nenabled = no\ncutting_torque_Nm = 0.3\n"
    "[tool]\ndiameter_m = 0.016\nteeth = 4\ntangential_coefficient_N_per_m2 = 1.7e9\n"
    "tangential_edge_N_per_m = 3e4\nradial_ratio = 0.3\nradial_edge_N_per_m = 2e4\n"
    "[cut]\nspindle_speed_rpm = 6000\nfeed_per_tooth_m = 60e-6\naxial_depth_m = 0.003\n"
    "radial_immersion_m = 0.008\ndirection = down\n"
    "[monitor.cutting-coefficients]\nteach_slots = 100\n"
    "[monitor.wear]\nspecific_force_ratio = 1.2\n";

MachineConfig config() {
  const auto file = MachineFile::parse(kMachine, "m.ini");
  CHECK(file);
  const auto signals = signals_of_file(*file);
  CHECK(signals);
  auto made = machine_config(*file, *signals);
  if (!made) check::fail(__FILE__, __LINE__) << made.error().sentence << '\n';
  return made ? std::move(*made) : MachineConfig{};
}

struct alignas(16) Storage {
  std::array<unsigned char, SERVOSENSE_STORAGE_BYTES> bytes;
};

servosense_cut_shares shares_of(const milled::Shop& shop) {
  const CuttingShares s = milled::shares(shop);
  return {s.torque_chip_m3,   s.torque_edge_m2,  s.x_tangential_chip_m2, s.x_tangential_edge_m,
          s.x_radial_chip_m2, s.x_radial_edge_m, s.y_tangential_chip_m2, s.y_tangential_edge_m,
          s.y_radial_chip_m2, s.y_radial_edge_m};
}

void programs() {
  const MachineConfig made = config();
  CHECK(made.config.coefficients.enabled == 1 && made.config.wear.enabled == 1);
  auto storage = std::make_unique<Storage>();
  servosense_stack* stack = nullptr;
  const char* where = "";
  const char* const fault =
      servosense_init(storage->bytes.data(), storage->bytes.size(), &made.config, &stack, &where);
  if (fault != nullptr) {
    check::fail(__FILE__, __LINE__) << where << ": " << fault << '\n';
    return;
  }
  const milled::Material sharp;
  milled::Machine<> m({}, sharp, 5);
  std::int64_t sample = 0;
  int warnings = 0, worn = 0;
  std::array<std::array<double, 2>, 2> before{};
  m.heard = [&](const milled::Heard& h) {
    servosense_sample in{};
    in.t_ns = sample++ * 125000;
    in.spindle.motion = h.angle_rad;
    in.spindle.effort = static_cast<float>(h.torque_Nm);
    for (std::size_t i = 0; i < 2; ++i) {  // the generator's axes weigh nothing
      const double speed = (h.position_m[i] - before[i][0]) / milled::kPeriod_s;
      in.axis[i].motion = h.position_m[i];
      in.axis[i].effort =
          static_cast<float>(h.force_N[i] + 50 * (speed - before[i][1]) / milled::kPeriod_s);
      before[i] = {h.position_m[i], speed};
    }
    std::array<servosense_event, SERVOSENSE_MAX_EVENTS> events;
    const int n = servosense_process(stack, &in, events.data(), SERVOSENSE_MAX_EVENTS);
    for (int k = 0; k < n; ++k) {
      const servosense_event& e = events[static_cast<std::size_t>(k)];
      // Behind a signal fault it warns again of the same change.
      if (e.monitor == SERVOSENSE_CUTTING_COEFFICIENTS && e.state == SERVOSENSE_WARNING &&
          e.before == SERVOSENSE_ARMED)
        ++warnings;
      if (e.monitor == SERVOSENSE_WEAR && e.state == SERVOSENSE_ALARM) ++worn;
    }
  };
  const auto mill = [&](int passes) {
    for (int pass = 0; pass < passes; ++pass) {
      milled::Pass p;
      p.length_m = 0.05;
      p.direction_rad = pass % 2 == 0 ? 0.6 : 0.6 + milled::kPi;
      p.feed_per_tooth_m = pass % 2 == 0 ? 45e-6 : 90e-6;
      m.mill(p);
    }
  };
  const auto found = [&](int which) { return servosense_cutting_coefficient(stack, which); };
  m.air(0.5, 6000);
  CHECK(found(SERVOSENSE_SPECIFIC_FORCE).told == 0);
  mill(4);
  const auto shares = shares_of(m.shop);
  const double specific =
      sharp.ktc + sharp.kte * shares.torque_edge_m2 / (shares.torque_chip_m3 * 60e-6);
  const std::array<double, 7> truth = {
      specific, 1, sharp.ktc, sharp.kte, sharp.krc, sharp.kre, sharp.krc / sharp.ktc};
  for (int which = SERVOSENSE_SPECIFIC_FORCE; which <= SERVOSENSE_RADIAL_RATIO; ++which) {
    const servosense_found f = found(which);
    const double t = truth[static_cast<std::size_t>(which)];
    CHECK(f.told == 1);
    CHECK(static_cast<double>(f.low) < t && static_cast<double>(f.high) > t);
    CHECK_NEAR(static_cast<double>(f.value) / t, 1, which == SERVOSENSE_K_RE ? 0.15 : 0.08);
  }
  // Half as deep again: told of it, it is none of wear, and no change.
  m.shop.depth_m *= 1.5;
  const auto deeper = shares_of(m.shop);
  CHECK(servosense_set_cut(stack, &deeper) == 0);
  mill(2);
  CHECK_NEAR(static_cast<double>(found(SERVOSENSE_FORCE_RATIO).value), 1, 0.03);
  float share = -1;
  CHECK(servosense_cutting_changes(stack, &share) == 0 && share == 0);
  CHECK(warnings == 0 && worn == 0 && servosense_stop_requested(stack) == 0);
  // A tool that asks for a third more, at once.
  m.material = {1.33 * sharp.ktc, 1.33 * sharp.kte, 1.33 * sharp.krc, 1.33 * sharp.kre};
  mill(4);
  CHECK(servosense_cutting_changes(stack, &share) == 1);
  CHECK_NEAR(static_cast<double>(share), 0.33, 0.05);
  CHECK_NEAR(static_cast<double>(found(SERVOSENSE_FORCE_RATIO).value), 1.33, 0.04);
  CHECK(warnings == 1);
  CHECK(worn == 1);
  CHECK(servosense_stop_requested(stack) == 1);
  // A new tool as sharp as the first, then the worn one again: of what it was taught.
  const servosense_taught first = servosense_taught_force(stack);
  CHECK_NEAR(static_cast<double>(first.specific_force_N_per_m2) / specific, 1, 0.03);
  const milled::Material worn_material = m.material;
  CHECK(servosense_new_tool(stack, nullptr) == 0);
  servosense_release_stop(stack);
  CHECK(found(SERVOSENSE_FORCE_RATIO).told == 0 && servosense_cutting_changes(stack, &share) == 0);
  CHECK(servosense_taught_force(stack).specific_force_N_per_m2 == 0);
  m.material = sharp;
  mill(4);
  CHECK_NEAR(static_cast<double>(found(SERVOSENSE_FORCE_RATIO).value), 1, 0.03);
  CHECK(servosense_cutting_changes(stack, &share) == 0 && worn == 1);
  CHECK(servosense_stop_requested(stack) == 0);
  CHECK(servosense_new_tool(stack, &first) == 0);
  m.material = worn_material;
  mill(2);
  CHECK_NEAR(static_cast<double>(found(SERVOSENSE_FORCE_RATIO).value), 1.33, 0.05);
  CHECK(worn == 2 && servosense_stop_requested(stack) == 1);
  const servosense_taught wrong = {-1, 0};
  CHECK(servosense_new_tool(stack, &wrong) == -1 && servosense_new_tool(nullptr, nullptr) == -1);
  auto none = deeper;
  none.torque_chip_m3 = 0;
  CHECK(servosense_set_cut(stack, &none) == -1 && servosense_set_cut(stack, nullptr) == -1);
  CHECK(std::isnan(found(99).value));
  servosense_reset(stack);
  CHECK(found(SERVOSENSE_SPECIFIC_FORCE).told == 0 &&
        servosense_cutting_changes(stack, nullptr) == 0);
}

void refused() {
  const MachineConfig made = config();
  auto storage = std::make_unique<Storage>();
  const auto path_of = [&](auto change) -> std::string {
    servosense_config c = made.config;
    change(c);
    servosense_stack* stack = nullptr;
    const char* where = "";
    const char* const fault =
        servosense_init(storage->bytes.data(), storage->bytes.size(), &c, &stack, &where);
    return fault == nullptr ? "" : where;
  };
  CHECK(path_of([](auto&) {}).empty());
  CHECK(path_of([](auto& c) { c.coefficients.shares.torque_edge_m2 = 0; }) ==
        "coefficients.shares");
  CHECK(path_of([](auto& c) { c.coefficients.radius_m = -1; }) == "coefficients.radius_m");
  CHECK(path_of([](auto& c) { c.coefficients.tangential.error = 0; }) == "coefficients.tangential");
  CHECK(path_of([](auto& c) { c.teeth = 0; }) == "teeth");
  CHECK(path_of([](auto& c) { c.axis[1].present = 0; }) == "coefficients.enabled");
  CHECK(path_of([](auto& c) { c.coefficients.enabled = 0; }) == "wear.specific_force_ratio");
  // Where they are not followed nothing is told.
  servosense_config c = made.config;
  c.coefficients.enabled = c.wear.enabled = 0;
  servosense_stack* stack = nullptr;
  CHECK(servosense_init(storage->bytes.data(), storage->bytes.size(), &c, &stack, nullptr) ==
        nullptr);
  CHECK(std::isnan(servosense_cutting_coefficient(stack, SERVOSENSE_K_TC).value));
  const auto shares = shares_of({});
  CHECK(servosense_set_cut(stack, &shares) == -1 && servosense_new_tool(stack, nullptr) == -1);
  CHECK(servosense_taught_force(stack).specific_force_N_per_m2 == 0);
  float share = 1;
  CHECK(servosense_cutting_changes(stack, &share) == 0 && share == 0);
}

}  // namespace

int main() {
  programs();
  refused();
  return check::done();
}
