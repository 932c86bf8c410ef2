// From frame to verdict as in a live run: decoder, aligner, sample source, monitors. No allocation
// once it runs; latencies are counted rightly; a soak with faults loses nothing unflagged.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <new>
#include <random>
#include <string>

#include "check.hpp"
#include "servosense/hal/can_decoder.hpp"
#include "servosense/hal/real_time_thread.hpp"
#include "servosense/hal/row_source.hpp"
#include "servosense/hal/trace_source.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace {
unsigned long allocations = 0;
}  // namespace

// Not inlined: g++ takes malloc and delete for a mismatch then.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  ++allocations;
  if (void* p = std::malloc(bytes)) return p;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { std::free(p); }

using namespace servosense;

namespace {

constexpr Nanoseconds kPeriod = 125000;

constexpr const char* kMap = R"(period_s = 0.000125
signal, frame, byte, type, factor
spindle.angle_counts, 0x181, 0, int32
spindle.current_A,    0x181, 4, int16, 0.001
sequence,             0x181, 7, uint8
x.position_m,         0x281, 0, int32, 1e-8
x.current_A,          0x281, 4, int16, 0.001
sequence,             0x281, 7, uint8
y.position_m,         0x381, 0, int32, 1e-8
y.current_A,          0x381, 4, int16, 0.001
sequence,             0x381, 7, uint8
)";

struct Injected {
  std::uint64_t lost = 0, twice = 0, swapped = 0, stalls = 0;
};

/// Three drives at 8 kHz, with faults, made as they are asked for.
class FaultyBus final : public RowSource {
 public:
  FaultyBus(double faults, unsigned seed, std::int64_t periods)
      : decoder_(*CanMap::parse(kMap, "map")), random_(seed), faults_(faults), periods_(periods) {}

  [[nodiscard]] const std::vector<Signal>& signals() const override {
    return decoder_.map().signals;
  }
  [[nodiscard]] double period_s() const override { return 125e-6; }
  Expected<bool> next(TraceRow& row) override {
    while (!decoder_.pop(row)) {
      if (period_ == periods_ + 1) return false;
      if (period_ == periods_) decoder_.finish();
      if (period_ < periods_) one_period();
      ++period_;
    }
    return true;
  }
  const CanDecoder& decoder() const { return decoder_; }
  Injected injected;

 private:
  double uniform() { return static_cast<double>(random_()) / 4294967296.0; }
  void one_period() {
    const double t = 125e-6 * static_cast<double>(period_);
    // The bus stands still for 2 ms now and then; then everything comes at once.
    if (faults_ > 0 && stalled_until_ <= period_ && uniform() < 1.0 / 4000) {
      stalled_until_ = period_ + 16;
      ++injected.stalls;
    }
    const Nanoseconds now = std::max(period_, stalled_until_) * kPeriod;
    const bool steady = period_ > 100 && period_ < periods_ - 100;
    for (unsigned drive = 0; drive < 3; ++drive) {
      CanFrame frame;
      frame.id = 0x181 + 0x100 * drive;
      frame.length = 8;
      frame.t_ns = now + (10 + 20 * drive) * 1000 + static_cast<Nanoseconds>(30000 * uniform());
      const double turns = 100 * t + 0.001 * std::sin(40 * t);
      const auto motion = drive == 0 ? static_cast<std::int64_t>(131072 * turns)
                                     : static_cast<std::int64_t>(2e6 * t);
      const auto bits = static_cast<std::uint32_t>(motion);
      const auto current = static_cast<std::uint16_t>(
          static_cast<std::int16_t>(500 + 20 * std::sin(300 * t) + 20 * uniform()));
      for (unsigned i = 0; i < 4; ++i) frame.data[i] = static_cast<std::uint8_t>(bits >> (8 * i));
      frame.data[4] = static_cast<std::uint8_t>(current);
      frame.data[5] = static_cast<std::uint8_t>(current >> 8U);
      frame.data[7] = static_cast<std::uint8_t>(period_);
      if (steady && uniform() < faults_) {
        ++injected.lost;
        continue;
      }
      CanFrame& held = held_[drive];
      if (held.length > 0) {  // the one that was held back comes behind this one
        decoder_.push(frame);
        held.t_ns = frame.t_ns;
        decoder_.push(held);
        held.length = 0;
        continue;
      }
      if (steady && uniform() < faults_) {
        ++injected.swapped;
        held = frame;
        continue;
      }
      decoder_.push(frame);
      if (steady && uniform() < faults_) {
        ++injected.twice;
        decoder_.push(frame);
      }
    }
  }

  CanDecoder decoder_;
  std::mt19937 random_;
  double faults_;
  std::int64_t periods_, period_ = 0, stalled_until_ = 0;
  std::array<CanFrame, 3> held_{};
};

void soak(double seconds) {
  auto machine = MachineFile::read("examples/machines/koike_tc_s2c.ini");
  CHECK(machine);
  if (!machine) return;
  machine->set("monitor.chatter", "chatter_threshold_Nm2", 5.0);
  auto rows = std::make_unique<FaultyBus>(0.001, 77, static_cast<std::int64_t>(8000 * seconds));
  const FaultyBus& bus = *rows;
  auto source = TraceSource::open(std::move(rows), "bus");
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
  const bool nightly = argc > 1 && std::string(argv[1]) == "--nightly";
  soak(nightly ? 600 : 10);
  latencies();
  return check::done();
}
