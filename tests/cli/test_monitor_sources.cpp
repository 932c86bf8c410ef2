// The same four seconds over every road a drive's samples can take: trace, candump of classic CAN,
// of packed CAN FD, and a Modbus buffer read live. The events must be the same, byte for byte.
#include <cmath>
#include <cstring>
#include <random>
#include <sstream>
#include <thread>

#include "hal/modbus_server.hpp"
#include "program.hpp"
#include "servosense/io/candump.hpp"

using namespace servosense;
using namespace program_test;

namespace {

constexpr Nanoseconds kPeriod = 125000;
constexpr std::size_t kSamples = 24000;  // 3 s
constexpr double kCountsPerTurn = 131072;

// A spindle at 6000 rpm that begins to chatter, an x axis that runs into something.
struct Record {
  std::vector<std::int32_t> counts, x_nm;
  std::vector<std::int16_t> spindle_mA, x_mA;
};

Record record() {
  Record r;
  std::mt19937 random(9);
  std::normal_distribution<double> noise;
  for (std::size_t n = 0; n < kSamples; ++n) {
    const double t = 125e-6 * static_cast<double>(n);
    const double chatter = t > 1 && t < 2 ? 6 * std::sin(2 * M_PI * 771.3 * t) : 0;
    const double torque = 0.4 + chatter + 0.02 * noise(random);
    const double contact = t > 2.5 && t < 2.7 ? std::min(4000.0, 4e5 * (t - 2.5)) : 0;
    const double force = 94 + 732 * 0.05 + contact + 5 * noise(random);
    r.counts.push_back(static_cast<std::int32_t>(std::llround(kCountsPerTurn * 100 * t)));
    r.x_nm.push_back(static_cast<std::int32_t>(std::llround(0.05e9 * t)));
    r.spindle_mA.push_back(static_cast<std::int16_t>(std::lround(1000 * torque / 0.5)));
    r.x_mA.push_back(
        static_cast<std::int16_t>(std::lround(force * 0.016 / (2 * M_PI) / 0.8 * 1000)));
  }
  return r;
}

constexpr const char* kMonitors = R"(
[monitor.chatter]
chatter_threshold_Nm2 = 1
)";

// The machine of the source, taught what its cuts do.
std::string machine() {
  std::string text = content(fs::current_path() / "examples/machines/koike_tc_s2c.ini");
  const std::string section = "[monitor.collision]\n";
  text.insert(text.find(section) + section.size(), "cutting_threshold_x_N_per_s = 14580\n");
  return text + kMonitors;
}

void put_bytes(CanFrame& frame, std::size_t at, const void* value, std::size_t bytes) {
  std::memcpy(frame.data.data() + at, value, bytes);
  frame.length = static_cast<std::uint8_t>(std::max<std::size_t>(frame.length, at + bytes));
}

void write_logs(const Record& r) {
  std::string classic, packed;
  for (std::size_t n = 0; n < kSamples; ++n) {
    const Nanoseconds t = static_cast<Nanoseconds>(n) * kPeriod;
    CanFrame spindle, x;
    spindle.t_ns = t;
    spindle.id = 0x181;
    put_bytes(spindle, 0, &r.counts[n], 4);
    put_bytes(spindle, 4, &r.spindle_mA[n], 2);
    x.t_ns = t + 40000;
    x.id = 0x281;
    put_bytes(x, 0, &r.x_nm[n], 4);
    put_bytes(x, 4, &r.x_mA[n], 2);
    classic += candump_line(spindle, "can0") + '\n' + candump_line(x, "can0") + '\n';
    if (n % 5 != 4) continue;
    CanFrame block;
    block.fd = true;
    block.id = 0x300;
    block.t_ns = t;
    const auto sequence = static_cast<std::uint8_t>(n / 5);
    put_bytes(block, 60, &sequence, 1);
    for (std::size_t k = 0; k < 5; ++k) {
      put_bytes(block, 12 * k, &r.counts[n - 4 + k], 4);
      put_bytes(block, 12 * k + 4, &r.spindle_mA[n - 4 + k], 2);
      put_bytes(block, 12 * k + 6, &r.x_nm[n - 4 + k], 4);
      put_bytes(block, 12 * k + 10, &r.x_mA[n - 4 + k], 2);
    }
    block.length = 64;
    packed += candump_line(block, "can0") + '\n';
  }
  put("classic.log", classic);
  put("packed.log", packed);
  put("classic.map",
      "period_s = 0.000125\nsignal, frame, byte, type, factor\n"
      "spindle.angle_counts, 0x181, 0, int32\nspindle.current_A, 0x181, 4, int16, 0.001\n"
      "x.position_m, 0x281, 0, int32, 1e-9\nx.current_A, 0x281, 4, int16, 0.001\n");
  put("packed.map",
      "period_s = 0.000125\nsignal, frame, byte, type, factor, samples, stride\n"
      "sequence, 0x300, 60, uint8\n"
      "spindle.angle_counts, 0x300, 0, int32,, 5, 12\nspindle.current_A, 0x300, 4, int16, 0.001, "
      "5, 12\n"
      "x.position_m, 0x300, 6, int32, 1e-9, 5, 12\nx.current_A, 0x300, 10, int16, 0.001, 5, 12\n");
  put("bus.dbc",
      "BO_ 385 Spindle: 6 Drive\n SG_ Position : 0|32@1- (1,0) [0|0] \"inc\" Control\n"
      " SG_ Current : 32|16@1- (1,0) [0|0] \"mA\" Control\n"
      "BO_ 641 X: 6 Drive\n SG_ Position : 0|32@1- (1,0) [0|0] \"nm\" Control\n"
      " SG_ Current : 32|16@1- (1,0) [0|0] \"mA\" Control\n");
  put("dbc.map",
      "period_s = 0.000125\ndbc = bus.dbc\nsignal, dbc\n"
      "spindle.angle_counts, Spindle.Position\nspindle.current_A, Spindle.Current\n"
      "x.position_m, X.Position\nx.current_A, X.Current\n");
  put("buffer.map",
      "period_s = 0.000125\nbuffer_samples = 4096\nsignal, register, type, factor, stride\n"
      "counter, 10, uint32\nspindle.angle_counts, 100, int32,, 6\nspindle.current_A, 102, int16, "
      "0.001, 6\n"
      "x.position_m, 103, int32, 1e-9, 6\nx.current_A, 105, int16, 0.001, 6\n");
}

// Events with times from the first row of their record on.
std::string events(const std::string& source, double start_s) {
  const Outcome o = run("monitor --quiet --machine m.ini " + source + " --events e.jsonl");
  if (o.status != 0) check::fail(__FILE__, __LINE__) << o.command << ": " << o.err;
  std::istringstream lines(content(folder / "e.jsonl"));
  std::string all;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t at = line.find("\"t_s\":") + 6;
    const std::size_t end = line.find(',', at);
    char text[40];
    std::snprintf(text, sizeof text, "%.6f",
                  std::abs(std::stod(line.substr(at, end - at)) - start_s));
    all += line.substr(0, at) + text + line.substr(end) + '\n';
  }
  return all;
}

double first_time(const std::string& trace) {
  std::istringstream lines(content(folder / trace));
  for (std::string line; std::getline(lines, line);)
    if (!line.empty() && (std::isdigit(static_cast<unsigned char>(line[0])) != 0))
      return std::stod(line.substr(0, line.find(',')));
  return std::nan("");
}

void four_roads() {
  const Record r = record();
  write_logs(r);
  put("m.ini", machine());
  const std::string classic = events("--candump classic.log --map classic.map --record t.csv", 0);
  for (const char* alarm :
       {"\"monitor\": \"chatter\", \"channel\": \"spindle\", \"state\": \"alarm\"",
        "\"monitor\": \"collision\", \"channel\": \"x\", \"state\": \"alarm\""})
    CHECK(contains(classic, alarm));
  CHECK_TEXT(events("--trace t.csv", 0), classic);
  CHECK_TEXT(events("--candump packed.log --map packed.map", 0), classic);
  CHECK_TEXT(events("--candump classic.log --map dbc.map", 0), classic);
  // A drive that replays the record at its own pace behind a Modbus buffer; what stands in the
  // buffer before its first sample is not asked for.
  const auto begin = std::chrono::steady_clock::now();
  std::atomic<bool> asked{false};
  auto start = begin;
  ModbusServer server(
      true,
      [&](unsigned first, unsigned count) {
        if (!asked.exchange(true)) start = std::chrono::steady_clock::now();
        auto now = static_cast<std::size_t>(
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() * 8000);
        now = std::min(now, kSamples);
        std::vector<std::uint16_t> words;
        for (unsigned i = first; i < first + count; ++i) {
          if (i < 100) {
            words.push_back(static_cast<std::uint16_t>(now >> (i == 10 ? 16U : 0U)));
            continue;
          }
          const std::size_t slot = (i - 100) / 6;
          const std::size_t n = slot < now ? now - 1 - (now - 1 - slot) % 4096 : 0;
          const auto high = [](std::int32_t v) {
            return static_cast<std::uint16_t>(static_cast<std::uint32_t>(v) >> 16U);
          };
          const std::uint16_t all[] = {high(r.counts[n]),
                                       static_cast<std::uint16_t>(r.counts[n]),
                                       static_cast<std::uint16_t>(r.spindle_mA[n]),
                                       high(r.x_nm[n]),
                                       static_cast<std::uint16_t>(r.x_nm[n]),
                                       static_cast<std::uint16_t>(r.x_mA[n])};
          words.push_back(all[(i - 100) % 6]);
        }
        return words;
      },
      [](unsigned) { return Misbehaviour::none; });
  const std::string live =
      "--modbus " + server.url() + " --map buffer.map --duration 4 --record live.csv";
  const std::string raw = events(live, 0);
  const double start_s = first_time("live.csv");
  // At the end the device falls silent, which the records do not show: compare up to there.
  auto until_silence = [](const std::string& text) {
    const std::size_t at = text.find("samples of spindle are missing");
    return at == std::string::npos ? text : text.substr(0, text.rfind('\n', at) + 1);
  };
  CHECK_TEXT(until_silence(events("--trace live.csv", start_s)), until_silence(classic));
  CHECK(contains(raw, "nothing arrives from spindle"));
  // And the live run said, while it ran, what its recording says now.
  const std::string again = events("--trace live.csv", 0);
  CHECK(raw.starts_with(again) && !again.empty());
}

void refused() {
  put("empty.map", "period_s = 1\n");
  const std::pair<const char*, int> cases[] = {
      {"", 2},
      {"--trace t.csv --candump classic.log", 2},
      {"--candump classic.log", 2},
      {"--trace t.csv --map classic.map", 2},
      {"--trace t.csv --duration 1", 2},
      {"--modbus nowhere --map buffer.map", 2},
      {"--modbus tcp://127.0.0.1:1 --map buffer.map", 4},
      {"--can nocan0 --map classic.map", 4},
      {"--candump classic.log --map empty.map", 3},
      {"--candump none.log --map classic.map", 4},
      {"--trace t.csv --pace 0", 2},
  };
  for (const auto& [source, status] : cases) {
    const Outcome o = run(std::string("monitor --quiet --machine m.ini ") + source);
    if (o.status != status || std::count(o.err.begin(), o.err.end(), '\n') != 1)
      check::fail(__FILE__, __LINE__) << o.command << ": status " << o.status << ", " << o.err;
    ++check::checks;
  }
}

// What is wrong, where, and what to do: nothing fails in silence.
void explained() {
  const std::string map =
      "period_s = 0.000125\nsignal, frame, byte, type, factor\n"
      "spindle.angle_counts, 0x181, 0, int32\n";
  put("ok.map", map + "spindle.current_A, 0x181, 4, int16, 0.001\n");
  put("channel.map", map + "spindel.current_A, 0x181, 4, int16, 0.001\n");
  put("quantity.map", map + "spindle.curent_A, 0x181, 4, int16, 0.001\n");
  put("twice.map", map + "x.current_A, 0x181, 4, int16\nx.current_A, 0x281, 4, int16\n");
  put("no_effort.map", map);
  put("absent.map", "period_s = 0.001\ndbc = absent.dbc\nsignal, dbc\nx.current_A, A.B\n");
  put("polled.map",
      "period_s = 0.05\nsignal, register, type\nspindle.speed_rad_s, 1, int16\n"
      "spindle.torque_Nm, 2, int16\n");
  put("short.log", "(1.000000) can0 181#000000000000\n(1.000125) can0 181#000000000000\n");
  put("others.log", "(1.000000) can0 281#000000000000\n");
  put("nothing.log", "");
  const std::string logged = "--candump short.log --map ok.map ";
  struct Case {
    std::string options;
    int status;
    std::vector<std::string> parts;
  };
  const std::vector<Case> cases = {
      // A kernel without CAN says so; one with it looks for the interface.
      {"--can nocan0 --map ok.map", 4, {"nocan0: ", "th"}},
      {"--can an_interface_of_that_name --map ok.map", 4, {"no name of an interface", "can0"}},
      {"--can nocan0 --map channel.map",
       3,
       {"channel.map:4: ", "the nearest channel is 'spindle'"}},
      {"--candump short.log --map quantity.map", 3, {"quantity.map:4: ", "'current_A'"}},
      {"--candump short.log --map twice.map", 3, {"twice.map:5: ", "'x.current_A' stands twice"}},
      {"--candump short.log --map no_effort.map", 3, {"short.log: ", "both motion and effort"}},
      {"--candump short.log --map absent.map",
       4,
       {"absent.dbc: cannot be opened", "check the path"}},
      {"--candump others.log --map ok.map", 3, {"others.log: ", "check its identifiers"}},
      {"--candump nothing.log --map ok.map", 3, {"nothing.log: ", "check its identifiers"}},
      {"--modbus tcp://127.0.0.1:1 --map polled.map",
       4,
       {"127.0.0.1:1: ", "refused", "check the "}},
      {"--modbus tcp://no-host.invalid --map polled.map", 4, {"no computer", "check the name"}},
      {"--modbus rtu:/dev/no-line --map polled.map", 4, {"/dev/no-line", "check the address"}},
      {"--modbus tcp://127.0.0.1:1 --map ok.map", 3, {"ok.map:2: unknown column 'frame'"}},
      {logged + "--record no/such/folder.csv", 4, {"folder.csv: cannot be written", "the right"}},
      {logged + "--report no/such/page.html", 4, {"page.html: cannot be written", "the right"}},
      {logged + "--events no/such/events", 4, {"no/such/events: cannot be written"}},
      {logged + "--shdr-device no/such/mill.xml", 4, {"mill.xml: cannot be written", "the path"}},
      {logged + "--shdr 7878 --shdr-address 192.0.2.1", 4, {"192.0.2.1:7878 ", "of this computer"}},
      {logged + "--shdr 7878 --shdr-address here", 2, {"no IPv4 address"}}};
  for (const Case& c : cases) {
    const Outcome o = run("monitor --quiet --machine m.ini " + c.options);
    that(o.status == c.status, o, "exit status " + std::to_string(c.status), __LINE__);
    that(one_sentence(o.err), o, "one sentence on standard error", __LINE__);
    for (const std::string& part : c.parts) that(contains(o.err, part), o, part, __LINE__);
  }
  // Where the events have standard output for themselves, what went wrong is still said.
  put("short.log",
      "(1.000000) can0 181#000000000000\n(1.000125) can0 181#0000\n"
      "(1.000250) can0 181#000000000000\n");
  const Outcome o = run("monitor --machine m.ini " + logged + "--events -");
  that(o.status == 0 && contains(o.err, "shorter than the map says"), o, "a note", __LINE__);
}

}  // namespace

int main() {
  program = std::getenv("SERVOSENSE_PROGRAM");
  if (program == nullptr) return check::done();
  folder = fs::temp_directory_path() / ("servosense_sources_" + std::to_string(getpid()));
  fs::create_directories(folder);
  four_roads();
  refused();
  explained();
  if (std::getenv("KEEP") == nullptr) fs::remove_all(folder);
  return check::done();
}
