// From frame to verdict as in a live run: decoder, aligner, sample source, monitors. No allocation
// once it runs; latencies are counted rightly; a soak with faults loses nothing unflagged.
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>

#include "check.hpp"
#include "count_allocations.hpp"
#include "faulty_bus.hpp"
#include "servosense/hal/real_time_thread.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

using namespace servosense;

namespace {

using namespace faulty_bus;

void soak(double seconds) {
  auto machine = MachineFile::read("examples/machines/koike_tc_s2c.ini");
  CHECK(machine);
  if (!machine) return;
  machine->set("monitor.chatter", "chatter_threshold_Nm2", 5.0);
  auto rows = std::make_unique<FaultyBus>(0.001, 77, static_cast<std::int64_t>(8000 * seconds));
  const FaultyBus& bus = *rows;
  auto source = SampleSource::open(std::move(rows), "bus");
  CHECK(source);
  if (!source) return;
  StackSignals signals;
  signals.sample_period_s = source->sample_period_s();
  signals.spindle = source->spindle()->signal;
  for (std::size_t i = 0; i < kAxes; ++i)
    if (source->axis(i)) signals.axis[i] = source->axis(i)->signal;
  const auto plan = plan_stack(*machine, signals);
  CHECK(plan);
  if (!plan) return;
  const auto stack = std::make_unique<HostStack>();
  stack->configure(plan->config);
  ServoSample<double> sample;
  std::uint64_t samples = 0, changes = 0, alarms = 0;
  unsigned long at_start = 0;
  for (;;) {
    const auto more = source->next(sample);
    if (!more || !*more) break;
    for (const auto& change : stack->process(sample)) {
      ++changes;
      if (change.state == MonitorState::alarm) ++alarms;
    }
    if (++samples == 4000) at_start = allocations;
  }
  const unsigned long made = allocations - at_start;
  const AlignerHealth& h = bus.decoder().aligner_health();
  std::printf(
      "  %.0f s: %llu samples, %llu frames lost, %llu twice, %llu out of order, %llu stalls, "
      "%llu changes of state, %llu alarms\n",
      seconds, static_cast<unsigned long long>(samples),
      static_cast<unsigned long long>(bus.injected.lost),
      static_cast<unsigned long long>(bus.injected.twice),
      static_cast<unsigned long long>(bus.injected.swapped),
      static_cast<unsigned long long>(bus.injected.stalls),
      static_cast<unsigned long long>(changes), static_cast<unsigned long long>(alarms));
  CHECK(made == 0);
  CHECK(h.lost == bus.injected.lost);
  CHECK(h.duplicates == bus.injected.twice);
  CHECK(h.reordered == bus.injected.swapped);
  CHECK(h.late == 0 && h.restarts == 0);
  CHECK(samples == static_cast<std::uint64_t>(8000 * seconds));
  CHECK(source->health().gaps == 0);
  CHECK(bus.injected.lost > static_cast<std::uint64_t>(10 * seconds));
  CHECK(bus.injected.stalls > static_cast<std::uint64_t>(seconds));
  CHECK(alarms == 0);  // a lost frame is no collision
}

void latencies() {
  LatencyHistogram h;
  CHECK(h.quantile_ns(0.5) == 0);
  h.watch(100000);
  for (int i = 1; i <= 1000; ++i) h.add(i * 1000);
  CHECK(h.count() == 1000);
  CHECK(h.greatest_ns() == 1000000);
  CHECK(h.overruns() == 900);
  CHECK_BETWEEN(static_cast<double>(h.quantile_ns(0.5)), 500e3, 500e3 * 1.19);
  CHECK_BETWEEN(static_cast<double>(h.quantile_ns(0.99)), 990e3, 1000e3);
  h.add(-5);
  h.add(Nanoseconds{1} << 60U);
  CHECK(h.quantile_ns(1) == Nanoseconds{1} << 60U);
  const RealTimeGrant grant = ask_for_real_time(10);
  CHECK((grant.memory_locked && grant.first_in_first_out) == grant.remark.empty());
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  soak(nightly ? 600 : 10);
  latencies();
  return check::done();
}
