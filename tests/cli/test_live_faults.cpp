// A live run that everything turns against: the disk fills up, the reader of its events goes away,
// the terminal hangs up, the controller says yes and runs on. It watches until its end, and says
// what is missing.
#include <poll.h>
#include <sys/resource.h>

#include <atomic>
#include <cmath>
#include <thread>

#include "hal/modbus_server.hpp"
#include "loopback.hpp"
#include "program.hpp"

using namespace program_test;

namespace {

constexpr double kRate = 8000;
constexpr const char* kBuffer =
    "period_s = 0.000125\nbuffer_samples = 4096\nsignal, register, type, factor, stride\n"
    "counter, 10, uint32\nx.position_m, 100, int32, 1e-9, 3\nx.current_A, 102, int16, 0.001, 3\n";

/// A drive that moves at 50 mm/s behind a Modbus buffer, and runs into something twice a second,
/// for 0.1 s.
class Drive {
 public:
  std::vector<std::uint16_t> operator()(unsigned first, unsigned count) const {
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
      const double t = static_cast<double>(n) / kRate;
      const double since = std::fmod(t, 0.5) - 0.4;
      const double contact_N = since > 0 ? std::min(4000.0, 4e5 * since) : 0;
      const double force_N = 94 + 732 * 0.05 + contact_N;
      const auto nm = static_cast<std::uint32_t>(n * 6250);
      const std::uint16_t all[] = {
          static_cast<std::uint16_t>(nm >> 16U), static_cast<std::uint16_t>(nm),
          static_cast<std::uint16_t>(std::lround(1000 * force_N * 0.016 / (2 * M_PI) / 0.8))};
      words.push_back(all[(i - 100) % 3]);
    }
    return words;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

class Machine {
 public:
  Machine()
      : server_(
            true, [this](unsigned first, unsigned n) { return drive_(first, n); },
            [](unsigned) { return Misbehaviour::none; }) {
    std::string text = content(fs::current_path() / "examples/machines/koike_tc_s2c.ini");
    const std::string section = "[monitor.collision]\n";
    text.insert(text.find(section) + section.size(), "cutting_threshold_x_N_per_s = 14580\n");
    put("m.ini", text);
    put("buffer.map", kBuffer);
  }
  [[nodiscard]] std::string monitor() const {
    return "monitor --machine m.ini --map buffer.map --modbus " + server_.url() + " ";
  }

 private:
  Drive drive_;
  ModbusServer server_;
};

/// Runs `before`, the program, and `after` as one line of the shell; what it prints comes through a
/// pipe, which no limit of file sizes holds up.
Outcome piped(const std::string& before, const std::string& arguments, const std::string& after) {
  const std::string line = "cd '" + folder.string() + "' && { " + before + " '" + program + "' " +
                           arguments + " 2>&1; echo \"status $?\"; } < /dev/null " + after;
  Outcome o{line, "", "", -1};
  std::FILE* const pipe = ::popen(line.c_str(), "r");
  char bytes[4096];
  for (std::size_t n = 0; (n = std::fread(bytes, 1, sizeof bytes, pipe)) > 0;)
    o.out.append(bytes, n);
  ::pclose(pipe);
  const std::size_t status = o.out.rfind("status ");
  if (status != std::string::npos) o.status = std::atoi(o.out.c_str() + status + 7);
  return o;
}

/// The JSON object among what was printed.
std::string object_in(const std::string& text) {
  const std::size_t begin = text.starts_with('{') ? 0 : text.find("\n{"), end = text.rfind("\n}");
  return begin < end && end != std::string::npos ? text.substr(begin, end + 2 - begin) : "";
}

std::size_t times(const std::string& text, const std::string& part) {
  std::size_t n = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
  return n;
}

void full_disk() {
  const Machine machine;
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{700, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  const Outcome o = piped("",
                          machine.monitor() +
                              "--duration 2.2 --events e.jsonl --record r.csv --estimates s.csv "
                              "--report r.html --json",
                          "");
  setrlimit(RLIMIT_FSIZE, &before);
  that(o.status == 4, o, "ends with status 4", __LINE__);
  // The guard has gone on: contacts come every half second.
  const Json json(object_in(o.out));
  check::figure("alarms beside a full disk", json.number("alarms"));
  that(json.ok && json.number("alarms") >= 3, o, "watches on", __LINE__);
  that(json.number("to_s") - json.number("from_s") > 1.5, o, "to the end", __LINE__);
  for (const char* file : {"e.jsonl", "r.csv", "s.csv"})
    that(times(o.out, std::string("servosense: ") + file +
                          ": not everything could be written (File too large); check the path, the "
                          "right to write there and the room on the disk; the run goes on") == 1,
         o, std::string(file) + ": complains once", __LINE__);
  that(contains(o.out, "line(s) are missing there") && contains(o.out, "row(s) are missing in it"),
       o, "says what is missing", __LINE__);
  CHECK(json.sizes.contains("not_written") && json.sizes.at("not_written") == 4);
  // What there is is whole, as far as it goes.
  const std::string events = content(folder / "e.jsonl");
  CHECK(!events.empty() && events.ends_with("}\n") && events.size() <= 700);
  for (const std::string& line : lines(events)) CHECK(Json(line).ok);
  // How many rows come before the one that does not fit depends on how they arrive.
  const std::string record = content(folder / "r.csv"), heading = "t_s,x.position_m,x.current_A\n";
  const std::size_t rows = record.find(heading);
  CHECK(rows != std::string::npos && record.ends_with('\n') && record.size() <= 700);
  if (rows != std::string::npos)
    for (const std::string& line : lines(record.substr(rows)))
      that(times(line, ",") == 2, {o.command, record, o.err, o.status}, "a whole row", __LINE__);
  CHECK(!fs::exists(folder / "r.html"));
}

/// Power fails: what there is is whole, and can be read.
void killed() {
  const Machine machine;
  const Outcome o = piped("timeout -s KILL 1.6",
                          machine.monitor() +
                              "--duration 60 --quiet --events e.jsonl --record r.csv "
                              "--estimates s.csv",
                          "");
  that(o.status == 137, o, "is killed", __LINE__);
  const std::string events = content(folder / "e.jsonl");
  CHECK(contains(events, "\"alarm\"") && events.ends_with("}\n"));
  for (const std::string& line : lines(events)) CHECK(Json(line).ok);
  const Outcome again = run("monitor --quiet --machine m.ini --trace r.csv --json");
  that(again.status == 0 && Json(again.out).number("samples") > 4000, again, "the record is whole",
       __LINE__);
  CHECK(content(folder / "s.csv").ends_with("\n"));
  for (const auto& entry : fs::directory_iterator(folder))
    CHECK(!contains(entry.path().filename().string(), ".part"));
}

void full_device_and_no_reader() {
  const Machine machine;
  const Outcome o = piped("", machine.monitor() + "--duration 1.2 --events /dev/full --json", "");
  const Json json(object_in(o.out));
  that(o.status == 4 && json.number("alarms") >= 1, o, "watches without its disk", __LINE__);
  that(contains(o.out, "No space left"), o, "says so", __LINE__);
  // Events on a pipe whose reader has gone.
  const std::string line = "cd '" + folder.string() + "' && ('" + program + "' " +
                           machine.monitor() +
                           "--duration 1.2 --events - --report p.html 2> err.txt; echo $? > "
                           "status.txt) | true";
  CHECK(std::system(line.c_str()) == 0);
  const Outcome gone{line, "", content(folder / "err.txt"),
                     std::atoi(content(folder / "status.txt").c_str())};
  that(gone.status == 4 && contains(gone.err, "standard output") &&
           contains(gone.err, "the run goes on"),
       gone, "watches without a reader", __LINE__);
  CHECK(contains(content(folder / "p.html"), "</html>"));
}

void signals_and_durations() {
  const Machine machine;
  for (const char* signal : {"HUP", "INT", "TERM"}) {
    const Outcome o =
        piped(std::string("timeout --preserve-status -s ") + signal + " 1",
              machine.monitor() + "--duration 1e10 --quiet --events e.jsonl --report q.html", "");
    that(o.status == 0 && contains(o.out, "Verdict: "), o, "ends in good order", __LINE__);
    CHECK(contains(content(folder / "q.html"), "</html>"));
    CHECK(contains(content(folder / "e.jsonl"), "armed"));
  }
  const Outcome o = piped("timeout -s KILL 60",
                          machine.monitor() + "--duration 1e-300 --quiet --events e.jsonl", "");
  that(o.status == 4 && contains(o.out, "nothing came"), o, "ends at once, and says so", __LINE__);
}

/// linuxcncrsh as far as it is asked, in front of a machine that never stops.
class RunningCnc {
 public:
  /// `paused`: what it says of itself after a pause.
  explicit RunningCnc(bool paused) : paused_(paused) {
    listener_ = listen_on_loopback(port_);
    thread_ = std::thread([this] { run(); });
  }
  RunningCnc(const RunningCnc&) = delete;
  RunningCnc& operator=(const RunningCnc&) = delete;
  ~RunningCnc() {
    stop_ = true;
    thread_.join();
    ::close(listener_);
  }
  [[nodiscard]] std::string url() const { return "linuxcnc://127.0.0.1:" + std::to_string(port_); }
  [[nodiscard]] unsigned pauses() const { return pauses_; }

 private:
  std::string reply(const std::string& line) {
    if (line.starts_with("hello")) return "HELLO ACK EMCNETSVR 1.1";
    if (line == "set echo off") return "SET ECHO ACK";
    if (line == "set pause") {
      ++pauses_;
      return "SET PAUSE ACK";
    }
    if (line.starts_with("set ")) {
      std::string what = line.substr(4, line.find(' ', 4) - 4);
      for (char& c : what) c = static_cast<char>(std::toupper(c));
      return "SET " + what + " ACK";
    }
    const bool held = paused_ && pauses_ > 0;
    if (line == "get program_status")
      return held ? "PROGRAM_STATUS PAUSED" : "PROGRAM_STATUS RUNNING";
    if (line == "get abs_act_pos")
      return "ABS_ACT_POS " + std::to_string(0.5 * ++looks_) + " 0 0 0 0 0";
    if (line == "get estop") return "ESTOP OFF";
    if (line == "get machine") return "MACHINE ON";
    if (line == "get enable") return "ENABLE ON";
    if (line == "get feed_override") return "FEED_OVERRIDE 100";
    return "ERROR OK";
  }
  void run() {
    int client = -1;
    std::string input;
    while (!stop_) {
      pollfd p{client >= 0 ? client : listener_, POLLIN, 0};
      if (::poll(&p, 1, 20) <= 0) continue;
      if (client < 0) {
        client = ::accept(listener_, nullptr, nullptr);
        continue;
      }
      char bytes[512];
      const ssize_t n = ::read(client, bytes, sizeof bytes);
      if (n <= 0) {
        ::close(client);
        client = -1;
        input.clear();
        continue;
      }
      input.append(bytes, static_cast<std::size_t>(n));
      for (std::size_t end = input.find('\n'); end != std::string::npos; end = input.find('\n')) {
        const std::string line = input.substr(0, input.find_first_of("\r\n"));
        input.erase(0, end + 1);
        const std::string answer = reply(line) + "\r\n";
        if (::send(client, answer.data(), answer.size(), MSG_NOSIGNAL) < 0) break;
      }
    }
    if (client >= 0) ::close(client);
  }

  bool paused_;
  std::uint16_t port_ = 0;
  int listener_ = -1;
  std::atomic<unsigned> pauses_{0};
  unsigned looks_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

void controller_that_runs_on() {
  const Machine machine;
  for (const bool paused : {false, true}) {
    const RunningCnc cnc(paused);
    const Outcome o = piped("timeout -s KILL 60",
                            machine.monitor() + "--quiet --duration " + (paused ? "3.6" : "1.8") +
                                " --cnc " + cnc.url(),
                            "");
    that(o.status == 4 && contains(o.out, "not seen to stand"), o, "is a failure", __LINE__);
    const char* const at_once =
        paused ? "says that the feed is held, and its axes move on; stop the machine by hand"
               : "acknowledges the feed hold and keeps running; stop the machine by hand";
    that(times(o.out, at_once) == 1, o, "says so once", __LINE__);
    // Before the end, that is above the summary.
    that(o.out.find(at_once) < o.out.find("Verdict: "), o, "at once", __LINE__);
    that(contains(o.out, "acknowledged 1 time(s), seen to stand 0 time(s)"), o, "counts", __LINE__);
    CHECK(cnc.pauses() > 1);
  }
}

}  // namespace

int main() {
  return in_own_folder("live_faults", [] {
    full_disk();
    killed();
    full_device_and_no_reader();
    signals_and_durations();
    controller_that_runs_on();
  });
}
