// Hostile Modbus slaves against the whole program: a run ends when it should, says that it heard
// nothing, raises a signal fault, and believes nothing that is not an answer. And against the
// source alone, polled: no row of theirs has values.
#include <cmath>
#include <memory>

#include "hal/hostile_modbus.hpp"
#include "program.hpp"
#include "servosense/hal/modbus_rows.hpp"

using namespace program_test;
using namespace servosense;
using hostile::kModes;
using hostile::Mode;

namespace {

constexpr double kRate = 8000;
constexpr const char* kBuffer =
    "period_s = 0.000125\nbuffer_samples = 4096\ntimeout_s = 0.1\n"
    "signal, register, type, factor, stride\n"
    "counter, 10, uint32\nx.position_m, 100, int32, 1e-9, 3\nx.current_A, 102, int16, 0.001, 3\n";
constexpr const char* kPolled =
    "period_s = 0.005\ntimeout_s = 0.1\nsignal, register, type, factor\n"
    "x.position_m, 100, int32, 1e-9\nx.current_A, 102, int16, 0.001\n";

/// A drive that moves steadily, at 50 mm/s: its counter, and a ring of 4096 records.
hostile::Server::Registers drive() {
  const auto start = std::chrono::steady_clock::now();
  return [start](unsigned first, unsigned count) {
    const auto now = static_cast<std::uint64_t>(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() * kRate);
    std::vector<std::uint16_t> words;
    for (unsigned i = first; i < first + count; ++i) {
      if (i < 100) {
        words.push_back(static_cast<std::uint16_t>(now >> (i == 10 ? 16U : 0U)));
        continue;
      }
      const std::uint64_t slot = (i - 100) / 3;
      const std::uint64_t n = slot < now ? now - 1 - (now - 1 - slot) % 4096 : 0;
      const auto nm = static_cast<std::uint32_t>(n * 6250);
      const std::uint16_t all[] = {static_cast<std::uint16_t>(nm >> 16U),
                                   static_cast<std::uint16_t>(nm), 415};
      words.push_back(all[(i - 100) % 3]);
    }
    return words;
  };
}

/// All of them at once: each run waits more than it works.
void whole_program() {
  put("m.ini", content(fs::current_path() / "examples/machines/koike_tc_s2c.ini"));
  put("buffer.map", kBuffer);
  std::vector<std::unique_ptr<hostile::Server>> servers;
  std::string script = "cd '" + folder.string() + "' || exit 1\n";
  for (std::size_t i = 0; i < kModes.size(); ++i) {
    servers.push_back(std::make_unique<hostile::Server>(kModes[i].first, drive()));
    const std::string n = std::to_string(i);
    // The shell's own deadline: a run that does not end is a failure, not a hang.
    script += "(timeout -s KILL 60 '" + std::string(program) +
              "' monitor --machine m.ini --map buffer.map --modbus " + servers.back()->url() +
              " --duration 1 --events e" + n + ".jsonl > o" + n + ".txt 2> r" + n +
              ".txt; echo $? > s" + n + ".txt) &\n";
  }
  put("all.sh", script + "wait\n");
  CHECK(std::system(("sh '" + (folder / "all.sh").string() + "'").c_str()) == 0);
  for (std::size_t i = 0; i < kModes.size(); ++i) {
    const std::string n = std::to_string(i);
    const Outcome o{kModes[i].second, content(folder / ("o" + n + ".txt")),
                    content(folder / ("r" + n + ".txt")),
                    std::atoi(content(folder / ("s" + n + ".txt")).c_str())};
    const std::string events = content(folder / ("e" + n + ".jsonl"));
    if (kModes[i].first == Mode::twice) {
      that(o.status == 0 && !contains(o.err, "nothing came"), o, "is understood", __LINE__);
      that(contains(events, "armed"), o, "watches", __LINE__);
      continue;
    }
    that(o.status == 4, o, "ends with status 4", __LINE__);
    that(contains(o.err, "nothing came from it"), o, "says so", __LINE__);
    that(contains(events, "signal-fault"), o, "is a signal fault", __LINE__);
    that(contains(o.out, "Verdict: not-watched"), o, "has its summary", __LINE__);
    // 20 ms, 40 ms, 80 ms... between two connections or refusals.
    const bool paced = kModes[i].first != Mode::frozen && kModes[i].first != Mode::refuses_data;
    if (paced) that(servers[i]->requests() <= 20, o, "is not pressed", __LINE__);
    if (kModes[i].first == Mode::refuses_data)
      that(servers[i]->requests() <= 40, o, "is not pressed", __LINE__);
    if (kModes[i].first == Mode::frozen)
      that(contains(o.err + o.out, "stood still"), o, "names the counter", __LINE__);
  }
}

void source_alone() {
  for (const auto& [mode, name] : kModes) {
    if (mode == Mode::frozen) continue;  // its registers are sound
    hostile::Server server(mode, drive());
    const std::atomic<bool> stop{false};
    auto map = ModbusMap::parse(kPolled, "map");
    if (!map) return check::that(false, "map", __FILE__, __LINE__);
    auto rows = ModbusRows::open(server.url(), std::move(*map), stop);
    if (!rows) {
      check::that(false, rows.error().sentence.c_str(), __FILE__, __LINE__);
      continue;
    }
    TraceRow row;
    unsigned valid = 0, seen = 0;
    for (; seen < 4; ++seen) {
      const auto more = (*rows)->next(row);
      if (!more || !*more) break;
      if (!row.fields.empty() && row.fields[0].state == TraceField::State::value) ++valid;
    }
    const bool lived_with = mode == Mode::twice;
    check::that(seen == 4 && valid == (lived_with ? 4U : 0U), name, __FILE__, __LINE__);
    const ModbusHealth& h = (*rows)->health();
    const bool counted = lived_with ? h.garbage + h.timeouts + h.exceptions == 0
                                    : h.garbage + h.timeouts + h.exceptions > 0;
    check::that(counted, name, __FILE__, __LINE__);
  }
}

// Ctrl-C is seen while an answer is waited for, whatever the time limit.
void stopped_in_between() {
  hostile::Server server(Mode::silent, drive());
  std::atomic<bool> stop{false};
  auto map = ModbusMap::parse(
      "period_s = 0.01\ntimeout_s = 60\nsignal, register, type\nx.position_m, 100, int32\n"
      "x.current_A, 102, int16\n",
      "map");
  auto rows = ModbusRows::open(server.url(), std::move(*map), stop);
  CHECK(rows);
  if (!rows) return;
  std::thread ctrl_c([&] {
    while (server.requests() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    stop = true;
  });
  TraceRow row;
  const auto more = (*rows)->next(row);
  ctrl_c.join();
  CHECK(more && !*more);
  CHECK((*rows)->health().timeouts == 0);  // it was not the time limit that ended it
}

}  // namespace

int main() {
  return in_own_folder("modbus_hostile", [] {
    whole_program();
    source_alone();
    stopped_in_between();
  });
}
