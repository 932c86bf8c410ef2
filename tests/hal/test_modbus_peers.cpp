// Modbus against slaves of other people: pymodbus over TCP and a serial line, modbus-serial (npm)
// over TCP, each behind a relay that spoils answers. Skips aloud what is not installed.
#include <signal.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>

#include "check.hpp"
#include "modbus_relay.hpp"
#include "servosense/hal/modbus_rows.hpp"

using namespace servosense;

namespace {

constexpr double kTimeLimit_s = 0.3;
constexpr const char* kMap = R"(period_s = 0.0002
timeout_s = 0.3
signal,               register, type,   factor
spindle.angle_counts, 100,      uint32
spindle.current_A,    102,      int16
x.position_m,         103,      float32
)";

/// A program that runs until it is destroyed.
class Process {
 public:
  explicit Process(const std::vector<std::string>& words) : pid_(fork()) {
    if (pid_ != 0) return;
    std::vector<char*> arguments;
    for (const std::string& w : words) arguments.push_back(const_cast<char*>(w.c_str()));
    arguments.push_back(nullptr);
    const int nowhere = ::open("/dev/null", O_RDWR);
    dup2(nowhere, 0);
    dup2(nowhere, 1);
    dup2(nowhere, 2);
    execvp(arguments[0], arguments.data());
    _exit(127);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process() {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }

 private:
  pid_t pid_;
};

bool succeeds(const std::string& command) {
  return std::system((command + " > /dev/null 2>&1").c_str()) == 0;
}

void polls(const char* what, const std::vector<std::string>& slave, bool tcp, unsigned count,
           unsigned seed) {
  std::mt19937 random(seed);
  std::atomic<unsigned> made[kSpoils] = {};
  std::atomic<std::uint64_t> faults{0};
  ModbusRelay relay(
      tcp,
      [&, place = 20U](unsigned n) mutable {
        // One request in forty, somewhere among them, each kind in its turn.
        if (n % 40 == 0) place = static_cast<unsigned>(random() % 40);
        if (n < 40 || n % 40 != place) return Spoil::none;
        auto kind = static_cast<Spoil>(1 + n / 40 % (kSpoils - 1));
        if (!tcp && kind == Spoil::disconnect) kind = Spoil::exception;
        ++made[static_cast<int>(kind)];
        if (kind != Spoil::slow) ++faults;
        return kind;
      },
      0.2 * kTimeLimit_s, 1.4 * kTimeLimit_s);
  std::vector<std::string> words = slave;
  words.emplace_back(tcp ? "tcp" : "rtu");
  words.push_back(relay.slave_address());
  const Process process(words);
  const bool serves = relay.start();
  check::that(serves, (std::string(what) + " serves").c_str(), __FILE__, __LINE__);
  if (!serves) return;
  auto map = ModbusMap::parse(kMap, "map");
  const std::atomic<bool> stop{false};
  auto rows = ModbusRows::open(relay.master_url(), std::move(*map), stop);
  check::that(rows.has_value(), rows ? what : rows.error().sentence.c_str(), __FILE__, __LINE__);
  if (!rows) return;

  TraceRow row;
  unsigned good = 0, invalid = 0, wrong = 0;
  std::int64_t before = 0;
  std::uint64_t faults_before = 0;
  Nanoseconds last_good_ns = 0, outage_ns = 0, t_ns = 0;
  while (good + invalid < count) {
    const auto more = (*rows)->next(row);
    if (!more || !*more) break;
    if (row.fields.empty()) continue;
    if (row.t_ns <= t_ns) ++wrong;
    t_ns = row.t_ns;
    if (row.fields[0].state == TraceField::State::invalid) {
      ++invalid;
      continue;
    }
    // Three numbers that agree, one more than the last that came, if nothing was spoilt.
    const std::int64_t number = row.fields[0].counts;
    if (row.fields[1].value != static_cast<double>(number % 30000) ||
        row.fields[2].value != static_cast<double>(static_cast<float>(number)))
      ++wrong;
    const auto between = static_cast<std::int64_t>(faults - faults_before);
    if (good > 0 && (number <= before || number > before + 1 + between)) ++wrong;
    before = number;
    faults_before = faults;
    if (good > 0) outage_ns = std::max(outage_ns, t_ns - last_good_ns);
    last_good_ns = t_ns;
    ++good;
  }
  const ModbusHealth& h = (*rows)->health();
  std::printf(
      "  %s: %u polls; slow %u, late %u, exception %u, truncated %u, garbage %u, hung up %u, "
      "silent "
      "%u; %u rows invalid, %llu connections, longest without a value %.2f s\n",
      what, count, made[1].load(), made[2].load(), made[3].load(), made[4].load(), made[5].load(),
      made[6].load(), made[7].load(), invalid, static_cast<unsigned long long>(h.connections),
      1e-9 * static_cast<double>(outage_ns));
  CHECK(good + invalid == count);
  CHECK(wrong == 0);
  // Every spoilt answer is a row of invalid values, the next one is good again; no other row is.
  CHECK(made[1] > 0 && made[2] > 0 && made[3] > 0 && made[4] > 0 && made[5] > 0 && made[7] > 0);
  CHECK(invalid == faults);
  CHECK(h.answered == good);
  CHECK(h.exceptions == made[3]);
  CHECK(h.timeouts + h.garbage == faults - made[3]);
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  const unsigned count = nightly ? 10000 : 360;
  std::string python;
  for (const char* p : {"python3", "/usr/bin/python3"})
    if (python.empty() && succeeds(std::string(p) + " -c 'import pymodbus, serial_asyncio'"))
      python = p;
  if (python.empty()) {
    std::cout << "SKIPPED: pymodbus is not installed (python3-pymodbus, python3-serial-asyncio)\n";
  } else {
    polls("pymodbus, TCP", {python, "tests/peers/modbus_slave.py"}, true, count, 11);
    polls("pymodbus, serial line", {python, "tests/peers/modbus_slave.py"}, false, count, 12);
  }
  if (succeeds("node -e 'require(\"modbus-serial\")'"))
    polls("modbus-serial, TCP", {"node", "tests/peers/modbus_slave.js"}, true, count, 13);
  else
    std::cout << "SKIPPED: no modbus-serial for node (npm install modbus-serial --ignore-scripts, "
                 "and NODE_PATH)\n";
  return check::done();
}
