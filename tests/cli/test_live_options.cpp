// What a live run of `servosense monitor` offers beside its samples: a feed hold on alarms, real
// time without the rights to it, and a replay at another pace.
#include <sys/resource.h>

#include <chrono>
#include <cmath>
#include <random>

#include "hal/modbus_server.hpp"
#include "loopback.hpp"
#include "program.hpp"
#include "sanitized.hpp"

using namespace program_test;

namespace {

constexpr std::size_t kRate = 8000;

// An x axis at 50 mm/s that runs into something at 0.5 s, and again at 1.2 s.
void write_trace() {
  std::mt19937 random(4);
  std::normal_distribution<double> noise;
  std::string text = "t_s,x.position_m,x.current_A\n";
  for (std::size_t n = 0; n < 2 * kRate; ++n) {
    const double t = static_cast<double>(n) / kRate;
    double contact = 0;
    for (const double at : {0.5, 1.2})
      if (t > at && t < at + 0.1) contact = std::min(4000.0, 4e5 * (t - at));
    const double force = 94 + 732 * 0.05 + contact + 5 * noise(random);
    char line[80];
    std::snprintf(line, sizeof line, "%.6f,%.9f,%.6f\n", t, 0.05 * t,
                  force * 0.016 / (2 * M_PI) / 0.8);
    text += line;
  }
  put("t.csv", text);
  // The spindle of the machine does not report, so the feed may be one of a cut.
  std::string machine = content(fs::current_path() / "examples/machines/koike_tc_s2c.ini");
  const std::string section = "[monitor.collision]\n";
  machine.insert(machine.find(section) + section.size(), "cutting_threshold_x_N_per_s = 14580\n");
  put("m.ini", machine);
}

void feed_hold() {
  const Outcome plain =
      run("monitor --quiet --machine m.ini --trace t.csv --json --events a.jsonl");
  const Outcome o =
      run("monitor --quiet --machine m.ini --trace t.csv --json --events b.jsonl --cnc simulated");
  const Json before(plain.out), after(o.out);
  that(plain.status == 0 && o.status == 0 && after.ok, o, "runs", __LINE__);
  CHECK(before.number("alarms") >= 2);
  CHECK(after.number("alarms") == before.number("alarms"));
  // Nobody releases the feed of the simulated CNC: the second contact joins the first.
  CHECK(after.number("feed_hold.asked") == 1 && after.number("feed_hold.acknowledged") == 1);
  CHECK(after.number("feed_hold.greatest_s") >= 0.002);  // it takes so long to answer
  CHECK(!before.scalars.contains("feed_hold.asked"));
  CHECK_TEXT(content(folder / "b.jsonl"), content(folder / "a.jsonl"));
  const Outcome text = run("monitor --quiet --machine m.ini --trace t.csv --cnc simulated");
  that(contains(text.out, "feed hold: asked for 1 time(s), acknowledged 1 time(s)"), text,
       "says what it did", __LINE__);
  // A threshold that the contact comes near to, and does not reach: steps of 1.2, for a warning
  // comes at three quarters.
  const std::string machine = content(folder / "m.ini");
  double alarms = 1;
  for (double threshold = 14580; alarms > 0 && threshold < 1e9; threshold *= 1.2) {
    std::string raised = machine;  // in the air and in the cut
    for (std::size_t at = 0;
         (at = raised.find("threshold_x_N_per_s = ", at)) != std::string::npos;) {
      at += 22;
      raised.replace(at, raised.find_first_of(" \n", at) - at, std::to_string(threshold));
    }
    put("w.ini", raised);
    const Outcome w = run("monitor --quiet --machine w.ini --trace t.csv --json");
    that(w.status == 0, w, "runs", __LINE__);
    alarms = Json(w.out).number("alarms");
  }
  for (const auto& [level, asked] : {std::pair<const char*, double>{"alarm", 0}, {"warning", 1}}) {
    const Outcome w = run(std::string("monitor --quiet --machine w.ini --trace t.csv --json --cnc "
                                      "simulated --stop-on ") +
                          level);
    that(Json(w.out).number("feed_hold.asked") == asked, w, "stops on its level", __LINE__);
  }
  const std::string m = "monitor --quiet --machine m.ini --trace t.csv ";
  refused(m + "--stop-on alarm", 2, {"--cnc"}, __LINE__);
  refused(m + "--cnc simulated --stop-on armed", 2, {"'alarm' or 'warning'"}, __LINE__);
  refused(m + "--cnc linuxcnc://127.0.0.1", 2, {"replay must not stop a machine"}, __LINE__);
  refused(m + "--cnc http://127.0.0.1", 2, {"linuxcnc://HOST:5007"}, __LINE__);
}

constexpr const char* kBuffer =
    "period_s = 0.000125\nbuffer_samples = 4096\nsignal, register, type, factor, stride\n"
    "counter, 10, uint32\nx.position_m, 100, int32, 1e-9, 3\nx.current_A, 102, int16, 0.001, 3\n";

/// A drive that moves steadily, behind a Modbus buffer.
class Drive {
 public:
  std::vector<std::uint16_t> operator()(unsigned first, unsigned count) {
    const auto now = static_cast<std::uint64_t>(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count() * kRate);
    std::vector<std::uint16_t> words;
    for (unsigned i = first; i < first + count; ++i) {
      if (i < 100) {
        words.push_back(static_cast<std::uint16_t>(now >> (i == 10 ? 16U : 0U)));
        continue;
      }
      const std::uint64_t slot = (i - 100) / 3;
      const std::uint64_t n = slot < now ? now - 1 - (now - 1 - slot) % 4096 : 0;
      const auto nm = static_cast<std::uint32_t>(n * 6250);  // 50 mm/s
      const std::uint16_t all[] = {static_cast<std::uint16_t>(nm >> 16U),
                                   static_cast<std::uint16_t>(nm), 415};
      words.push_back(all[(i - 100) % 3]);
    }
    return words;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// Without the rights to real time: a warning that says what to do, and everything works.
void unprivileged() {
  put("buffer.map", kBuffer);
  Drive drive;
  ModbusServer server(
      true, [&](unsigned first, unsigned n) { return drive(first, n); },
      [](unsigned) { return Misbehaviour::none; });
  std::string as_nobody;
  std::string limits = "ulimit -l 0; ulimit -r 0; ";
  if (getuid() == 0) {
    if (std::system("setpriv --version > /dev/null 2>&1") != 0) {
      std::cout << "SKIPPED: setpriv is not there to lower the rights of root\n";
      return;
    }
    as_nobody = "setpriv --reuid 65534 --regid 65534 --clear-groups ";
  }
  fs::permissions(folder, fs::perms::all);
  // The program may stand where nobody else may look.
  fs::copy_file(program, folder / "program", fs::copy_options::overwrite_existing);
  const std::string line = "cd '" + folder.string() + "' && sh -c '" + limits + "exec " +
                           as_nobody + "./program monitor --machine m.ini --modbus " +
                           server.url() +
                           " --map buffer.map --duration 1 --realtime --events e.jsonl --record "
                           "r.csv --json' > out.txt 2> err.txt < /dev/null";
  const int raw = std::system(line.c_str());
  Outcome o{line, content(folder / "out.txt"), content(folder / "err.txt"),
            WIFEXITED(raw) ? WEXITSTATUS(raw) : -1};
  that(o.status == 0, o, "works", __LINE__);
  // The address sanitizer says yes to locking memory, whoever asks.
  that((kSanitized || contains(o.err, "servosense: note: memory is not locked")) &&
           contains(o.err, "SCHED_FIFO is not granted") && contains(o.err, "CAP_SYS_NICE"),
       o, "says what is missing and how to get it", __LINE__);
  const Json json(o.out);
  CHECK(json.ok && contains(o.out, "SCHED_FIFO is not granted"));
  CHECK(json.number("samples") > 0.5 * kRate && json.number("alarms") == 0);
  CHECK(json.number("latency.greatest_s") > 0);
  CHECK(contains(content(folder / "e.jsonl"), "\"armed\""));
}

// An MTConnect agent that was written by the standard alone reads along.
void agent() {
  std::string python;
  for (const char* p : {"python3", "/usr/bin/python3"})
    if (python.empty() && std::system((std::string(p) + " -c '' > /dev/null 2>&1").c_str()) == 0)
      python = p;
  if (python.empty()) {
    std::cout << "SKIPPED: no python3 to read what the MTConnect adapter says\n";
    return;
  }
  const std::string reader = (fs::current_path() / "tests/peers/shdr_reader.py").string();
  // A machine whose name is no identifier, and a drive beside the axis, so that every kind of item
  // is there; played at its own pace.
  std::string trace, machine = content(folder / "m.ini");
  machine.replace(machine.find("name = "), 7, "name = 5 <axes> & ");
  machine += "\n[monitor.chatter]\nchatter_threshold_Nm2 = 5\n\n[tool]\nteeth = 4\n";
  put("agent.ini", machine);
  std::size_t n = 0;
  for (const std::string& line : lines(content(folder / "t.csv"))) {
    char more[60];
    std::snprintf(more, sizeof more, ",%.6f,%.4f\n", 0.05 * static_cast<double>(n),
                  0.8 + (n / 400 % 2 == 0 ? 0.01 : 0.0));
    trace += line + (n == 0 ? ",spindle.angle_rad,spindle.current_A\n" : more);
    ++n;
  }
  put("agent.csv", trace);
  const std::uint16_t free_port = free_port_on_loopback();
  CHECK(free_port > 0);
  const std::string port = std::to_string(free_port);
  const std::string line =
      "cd '" + folder.string() + "' || exit; '" + program +
      "' monitor --quiet --machine agent.ini --trace agent.csv --pace 1 --shdr " + port +
      " --shdr-device dev.xml > run.txt 2>&1 & sleep 0.5; " + python + " '" + reader + "' " + port +
      " dev.xml > reader.txt 2>&1; wait";
  CHECK(std::system(line.c_str()) != -1);
  const Outcome o{line, content(folder / "reader.txt"), content(folder / "run.txt"), 0};
  that(contains(o.out, " 0 wrong"), o, "an agent understands all of it", __LINE__);
  std::cout << "  MTConnect reader: " << o.out;
  CHECK(contains(content(folder / "dev.xml"), "5 &lt;axes&gt; &amp;"));
}

// Whatever the pace, the events are the same; ten times as fast takes at least a tenth of the time.
void pace() {
  const Outcome fast = run("monitor --quiet --machine m.ini --trace t.csv --events fast.jsonl");
  const auto begin = std::chrono::steady_clock::now();
  const Outcome paced =
      run("monitor --quiet --machine m.ini --trace t.csv --pace 10 --events paced.jsonl");
  const double took =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  that(fast.status == 0 && paced.status == 0, paced, "runs", __LINE__);
  CHECK(took >= 0.2 - 1e-3);  // a sleep never ends early: no assertion on how fast the computer is
  CHECK_TEXT(content(folder / "paced.jsonl"), content(folder / "fast.jsonl"));
  CHECK(!content(folder / "fast.jsonl").empty());
}

}  // namespace

int main() {
  return in_own_folder("live_options", [] {
    write_trace();
    feed_hold();
    unprivileged();
    agent();
    pace();
  });
}
