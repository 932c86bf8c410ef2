// Ten seconds (--nightly: ten minutes) of a live run in real time on a bad bus, with every sink at
// work: recording, events, an MTConnect client, a stop request. Everything that goes wrong is
// counted, nothing grows, and the recording gives the same events again, byte for byte.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>

#include "check.hpp"
#include "faulty_bus.hpp"
#include "loopback.hpp"
#include "sanitized.hpp"
#include "servosense/hal/mtconnect.hpp"
#include "servosense/hal/real_time_thread.hpp"
#include "servosense/hal/recording_rows.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/hal/simulated_cnc.hpp"
#include "servosense/hal/stop_request.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/event_text.hpp"
#include "servosense/monitors/stack_config.hpp"

using namespace servosense;
using namespace faulty_bus;

namespace {

using Clock = std::chrono::steady_clock;

std::size_t resident_kB() {
  std::ifstream in("/proc/self/statm");
  std::size_t size = 0, resident = 0;
  in >> size >> resident;
  return resident * static_cast<std::size_t>(sysconf(_SC_PAGESIZE)) / 1024;
}

/// An MTConnect agent's ear: reads until the adapter goes.
class Agent {
 public:
  explicit Agent(std::uint16_t port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address = loopback(port);
    CHECK(::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0);
    thread_ = std::thread([this] {
      char bytes[4096];
      std::string line;
      for (ssize_t n = 0; (n = ::recv(socket_, bytes, sizeof bytes, 0)) > 0;)
        for (ssize_t i = 0; i < n; ++i) {
          if (bytes[i] != '\n') {
            line += bytes[i];
            continue;
          }
          if (line.find("|x_force|") != std::string::npos) ++values;
          if (line.find("|signal_") != std::string::npos) ++conditions;
          line.clear();
        }
    });
  }
  Agent(const Agent&) = delete;
  Agent& operator=(const Agent&) = delete;
  ~Agent() { ::close(socket_); }
  void join() { thread_.join(); }
  /// Gives it time: it may not have run while the bus had the processor.
  void wait_for(std::uint64_t expected_values) const {
    for (int i = 0; i < 1000 && values < expected_values; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  std::atomic<std::uint64_t> values = 0, conditions = 0;

 private:
  int socket_;
  std::thread thread_;
};

struct Stack {
  std::unique_ptr<HostStack> stack = std::make_unique<HostStack>();
  StackPlan plan;
  explicit Stack(const SampleSource& source) {
    auto machine = MachineFile::read("examples/machines/koike_tc_s2c.ini");
    CHECK(machine);
    if (!machine) return;
    machine->set("monitor.chatter", "chatter_threshold_Nm2", 5.0);
    StackSignals signals;
    signals.sample_period_s = source.sample_period_s();
    signals.spindle = source.spindle()->signal;
    for (std::size_t i = 0; i < kAxes; ++i)
      if (source.axis(i)) signals.axis[i] = source.axis(i)->signal;
    auto planned = plan_stack(*machine, signals);
    CHECK(planned);
    if (!planned) return;
    plan = std::move(*planned);
    prepare(*stack, plan);
  }
};

void soak(double seconds) {
  const auto folder = std::filesystem::temp_directory_path();
  const std::string trace = folder / ("servosense_soak_" + std::to_string(getpid()) + ".csv");
  const auto periods = static_cast<std::int64_t>(8000 * seconds);
  auto bus_owner = std::make_unique<FaultyBus>(0.001, 99, periods);
  FaultyBus* const bus = bus_owner.get();
  auto writer = TraceWriter::create(trace, bus->signals(), {});
  CHECK(writer);
  if (!writer) return;
  const auto record = std::make_shared<TraceWriter>(std::move(*writer));
  const auto begin = Clock::now() + std::chrono::milliseconds(20);
  Nanoseconds delivered_ns = 0;  // when the last frames came, by the clock of the bus
  bus->before_frames = [&](Nanoseconds t_ns) {
    std::this_thread::sleep_until(begin + std::chrono::nanoseconds(t_ns));
    delivered_ns = t_ns;
  };
  auto source =
      SampleSource::open(std::make_unique<RecordingRows>(std::move(bus_owner), record), "bus");
  CHECK(source);
  if (!source) return;
  Stack monitors(*source);
  auto server = ShdrServer::open({.port = 0});
  CHECK(server);
  if (!server) return;
  Agent agent(server->port());
  SimulatedCncConfig real;
  real.real_time = true;
  SimulatedCnc cnc(real);
  StopRequest stop(cnc);
  stop.start();
  const RealTimeGrant grant = ask_for_real_time(50);
  if (!grant.remark.empty()) std::printf("  note: %s\n", grant.remark.c_str());

  LatencyHistogram from_instant, from_arrival;
  from_instant.watch(kPeriod);
  from_arrival.watch(kPeriod);
  std::string events;
  ServoSample<double> sample;
  std::uint64_t samples = 0, changes = 0, signal_changes = 0, alarms = 0, values = 0;
  std::size_t resident_early = 0;
  for (;;) {
    const auto more = source->next(sample);
    if (!more || !*more) break;
    for (const auto& change : monitors.stack->process(sample)) {
      const Event event = event_from(change, sample.t_ns);
      events += to_json_line(event) + '\n';
      publish(*server, sample.t_ns, event);
      ++changes;
      if (change.monitor == MonitorId::signal) ++signal_changes;
      if (change.state == MonitorState::alarm) {
        ++alarms;
        stop.raise(cnc.now_ns());
      }
    }
    if (++samples % 800 == 0) {
      server->value(sample.t_ns, "x_force", monitors.stack->axis(0).estimate);
      ++values;
    }
    const Nanoseconds now =
        std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - begin).count();
    from_instant.add(now - sample.t_ns);
    from_arrival.add(now - delivered_ns);
    if (samples == static_cast<std::uint64_t>(periods) / 5) resident_early = resident_kB();
  }
  const std::size_t resident_late = resident_kB();
  const AlignerHealth& h = bus->decoder().aligner_health();
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf(
      "  %.0f s: %llu samples; frames lost %llu, twice %llu, out of order %llu, stalls of 2 ms "
      "%llu; "
      "%llu changes of state, %llu alarms\n",
      seconds, count(samples), count(bus->injected.lost), count(bus->injected.twice),
      count(bus->injected.swapped), count(bus->injected.stalls), count(changes), count(alarms));
  CHECK(h.lost == bus->injected.lost && h.duplicates == bus->injected.twice);
  CHECK(h.reordered == bus->injected.swapped && h.late == 0 && h.restarts == 0);
  CHECK(samples == static_cast<std::uint64_t>(periods) && source->health().gaps == 0);
  CHECK(bus->injected.lost > 0 && bus->injected.twice > 0 && bus->injected.swapped > 0 &&
        bus->injected.stalls > 0);
  // A lost frame is no collision, and stops no machine.
  CHECK(alarms == 0);
  CHECK(record->close());
  stop.stop();
  CHECK(stop.health().raised == 0 && cnc.truth().holds == 0);
  // What was said was heard; a client that connects is told the present values first.
  agent.wait_for(values);
  server = ShdrServer::open({.port = 0});
  agent.join();
  CHECK(agent.values == values && agent.conditions >= signal_changes);
  CHECK(agent.conditions <= signal_changes + 4);
  // A byte for every sample would be seen.
  const double growth_kB = static_cast<double>(resident_late) -
                           static_cast<double>(resident_early) -
                           static_cast<double>(events.capacity()) / 1024;
  check::figure("resident memory after a fifth of the time", static_cast<double>(resident_early),
                "kB");
  check::figure("  and what it has grown by at the end", growth_kB, "kB");
  if (kSanitized)
    std::printf("  (memory is not judged under a sanitizer)\n");
  else
    CHECK(growth_kB < std::max(256.0, 0.8 * static_cast<double>(periods) / 1024));
  const auto report = [](const char* name, const LatencyHistogram& l) {
    std::printf(
        "  %s: median %.0f us, 99 %% %.0f us, 99.9 %% %.0f us, greatest %.0f us; beyond a "
        "period %.3f %%\n",
        name, 1e-3 * static_cast<double>(l.quantile_ns(0.5)),
        1e-3 * static_cast<double>(l.quantile_ns(0.99)),
        1e-3 * static_cast<double>(l.quantile_ns(0.999)),
        1e-3 * static_cast<double>(l.greatest_ns()),
        100 * static_cast<double>(l.overruns()) / static_cast<double>(l.count()));
  };
  report("from the servo instant to the verdict, stalls and waiting for lost frames included",
         from_instant);
  report("from the frames' arrival to the verdict", from_arrival);

  auto reader = TraceReader::open(trace);
  CHECK(reader);
  auto replay = SampleSource::open(std::move(*reader), trace);
  CHECK(replay);
  if (!replay) return;
  Stack again(*replay);
  std::string repeated;
  for (;;) {
    const auto more = replay->next(sample);
    if (!more || !*more) break;
    for (const auto& change : again.stack->process(sample))
      repeated += to_json_line(event_from(change, sample.t_ns)) + '\n';
  }
  CHECK(repeated == events && !events.empty());
  std::filesystem::remove(trace);
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  soak(nightly ? 600 : 10);
  return check::done();
}
