// The same servo samples over four roads: trace file, classic CAN, packed CAN FD, with and without
// SYNC. CAN goes through candump text. What comes out must be the numbers of the frames, to the
// last bit, and the same rows on each road.
#include <cmath>
#include <cstring>
#include <random>
#include <sstream>

#include "check.hpp"
#include "io/malformed.hpp"
#include "servosense/hal/candump_rows.hpp"
#include "servosense/hal/sample_source.hpp"

using namespace servosense;

namespace {

constexpr Nanoseconds kPeriod = 125000;
constexpr Nanoseconds kStart = 1'700'000'000'000'000'000;

// What the drives hold: spindle and x, counts and thousandths of the rated current.
struct Truth {
  std::vector<std::int32_t> spindle_counts, x_counts_um10;
  std::vector<std::int16_t> spindle_current, x_current;
};

Truth truth(std::size_t rows) {
  Truth t;
  std::mt19937 random(71);
  std::int64_t counts = 2'147'480'000;  // wraps on the way
  for (std::size_t i = 0; i < rows; ++i) {
    counts += 1300 + static_cast<std::int64_t>(random() % 100);
    t.spindle_counts.push_back(static_cast<std::int32_t>(static_cast<std::uint32_t>(counts)));
    t.x_counts_um10.push_back(
        static_cast<std::int32_t>(1e6 * std::sin(1e-3 * static_cast<double>(i))));
    t.spindle_current.push_back(static_cast<std::int16_t>(random()));
    t.x_current.push_back(static_cast<std::int16_t>(random()));
  }
  return t;
}

// Little-endian bytes, written apart from the reader.
void put(CanFrame& frame, std::size_t at, const void* value, std::size_t bytes) {
  std::memcpy(frame.data.data() + at, value, bytes);
  frame.length = static_cast<std::uint8_t>(std::max<std::size_t>(frame.length, at + bytes));
}

std::string classic_log(const Truth& t, bool sync) {
  std::string log;
  for (std::size_t i = 0; i < t.x_current.size(); ++i) {
    const Nanoseconds at = kStart + static_cast<Nanoseconds>(i) * kPeriod;
    CanFrame frame;
    frame.t_ns = at;
    frame.id = 0x80;
    if (sync) log += candump_line(frame, "can0") + '\n';
    frame.t_ns = at + 20000;
    frame.id = 0x181;
    put(frame, 0, &t.spindle_counts[i], 4);
    put(frame, 4, &t.spindle_current[i], 2);
    const std::uint16_t status = 0x0237;
    put(frame, 6, &status, 2);
    log += candump_line(frame, "can0") + '\n';
    CanFrame axis;
    axis.t_ns = at + 50000;
    axis.id = 0x182;
    put(axis, 0, &t.x_counts_um10[i], 4);
    put(axis, 4, &t.x_current[i], 2);
    log += candump_line(axis, "can0") + '\n';
  }
  return log;
}

constexpr const char* kClassicMap = R"(# two drives
period_s = 0.000125
signal,               frame, byte, type,   factor
spindle.angle_counts, 0x181, 0,    int32
spindle.current_A,    0x181, 4,    int16,  0.001*12.5
spindle.status_word,  0x181, 6,    uint16
x.position_m,         0x182, 0,    int32,  1e-7
x.current_A,          0x182, 4,    int16,  0.001*8
)";

// Four samples a frame, oldest first, 12 bytes each, behind a counter of 16 bits.
std::string packed_log(const Truth& t) {
  std::string log;
  for (std::size_t i = 0; i + 4 <= t.x_current.size(); i += 4) {
    CanFrame frame;
    frame.fd = frame.bit_rate_switch = frame.extended = true;
    frame.id = 0x18FF0001;
    frame.t_ns = kStart + static_cast<Nanoseconds>(i + 3) * kPeriod + 30000;
    const auto sequence = static_cast<std::uint16_t>(i / 4 + 65000);
    put(frame, 0, &sequence, 2);
    for (std::size_t k = 0; k < 4; ++k) {
      put(frame, 2 + 12 * k, &t.spindle_counts[i + k], 4);
      put(frame, 6 + 12 * k, &t.spindle_current[i + k], 2);
      put(frame, 8 + 12 * k, &t.x_counts_um10[i + k], 4);
      put(frame, 12 + 12 * k, &t.x_current[i + k], 2);
    }
    frame.length = 64;
    log += candump_line(frame, "can0") + '\n';
  }
  return log;
}

constexpr const char* kPackedMap = R"(period_s = 0.000125
signal,               frame,      byte, type,   factor,     samples, stride
sequence,             0x18FF0001, 0,    uint16
spindle.angle_counts, 0x18FF0001, 2,    int32,  ,           4,       12
spindle.current_A,    0x18FF0001, 6,    int16,  0.001*12.5, 4,       12
x.position_m,         0x18FF0001, 8,    int32,  1e-7,       4,       12
x.current_A,          0x18FF0001, 12,   int16,  0.001*8,    4,       12
)";

std::unique_ptr<CandumpRows> rows_of(const std::string& log, const std::string& map_text) {
  auto map = CanMap::parse(map_text, "map");
  if (!map) {
    check::fail(__FILE__, __LINE__) << map.error().sentence << '\n';
    return nullptr;
  }
  return std::make_unique<CandumpRows>(
      CandumpReader::from_stream(std::make_unique<std::istringstream>(log), "log"),
      std::move(*map));
}

void to_the_last_bit(CandumpRows& rows, const Truth& t) {
  TraceRow row;
  std::size_t n = 0;
  bool right = true;
  Nanoseconds first = 0;
  for (;;) {
    const auto more = rows.next(row);
    CHECK(more);
    if (!more || !*more) break;
    if (n == 0) first = row.t_ns;
    const auto i = static_cast<std::size_t>((row.t_ns - first) / kPeriod);
    right = right && i == n && row.t_ns == first + static_cast<Nanoseconds>(i) * kPeriod;
    right = right && i < t.x_current.size() && row.fields[0].counts == t.spindle_counts[i] &&
            row.fields[1].value == t.spindle_current[i] * (0.001 * 12.5) &&
            row.fields[2].value == t.x_counts_um10[i] * 1e-7 &&
            row.fields[3].value == t.x_current[i] * (0.001 * 8);
    ++n;
  }
  CHECK(right);
  CHECK(n == t.x_current.size());
  for (const std::string& remark : rows.remarks()) std::printf("  %s\n", remark.c_str());
  CHECK(rows.remarks().empty());
}

void four_roads() {
  const Truth t = truth(4000);
  const auto classic = rows_of(classic_log(t, false), kClassicMap);
  const auto synchronous =
      rows_of(classic_log(t, true), std::string("sync = 0x080\n") + kClassicMap);
  const auto packed = rows_of(packed_log(t), kPackedMap);
  for (const auto& rows : {&classic, &synchronous, &packed})
    if (*rows) to_the_last_bit(**rows, t);
  // As servo samples.
  auto source = SampleSource::open(rows_of(packed_log(t), kPackedMap), "log");
  CHECK(source);
  if (!source) return;
  CHECK_NEAR(source->sample_period_s(), 125e-6, 1e-12);
  ServoSample<double> sample;
  std::size_t n = 0;
  while (*source->next(sample)) {
    if (sample.spindle.counts != t.spindle_counts[n]) break;
    ++n;
  }
  CHECK(n == t.x_current.size());
  CHECK(source->health().gaps == 0);
}

// What goes wrong on a bus is told, and nothing else is harmed.
void told() {
  const Truth t = truth(1000);
  std::string log = classic_log(t, false);
  std::string worse;
  std::istringstream lines(log);
  int n = 0;
  for (std::string line; std::getline(lines, line); ++n) {
    if (n == 600) continue;                                   // lost
    if (n == 700) line = line.substr(0, line.find('#') + 5);  // two bytes left
    worse += line + '\n';
    if (n == 800)
      worse +=
          "(1700000000.050000) can0 20000044#0002000000000000\n"
          "(1700000000.050000) can0 701#05\n(1700000000.050000) can0 181#R8\n"
          "(1700000000.050000) can0 123#00\n";
  }
  const auto rows = rows_of(worse, std::string("heartbeat = 0x701 0x702\n") + kClassicMap);
  if (!rows) return;
  TraceRow row;
  std::size_t count = 0, invalid = 0;
  while (*rows->next(row)) {
    ++count;
    for (const TraceField& f : row.fields) invalid += f.state == TraceField::State::invalid;
  }
  CHECK(count == 1000);
  CHECK(invalid == 4);
  const CanHealth& health = rows->decoder().health();
  CHECK(health.too_short == 1 && health.errors == 1 && health.bus_off == 1);
  CHECK(health.overflows == 1 && health.heartbeats == 1 && health.remote == 1 &&
        health.unknown == 1);
  CHECK(rows->decoder().aligner_health().lost == 1);
  std::string all;
  for (const std::string& remark : rows->remarks()) all += remark + '\n';
  for (const char* part : {"1 frame was lost", "shorter than the map says", "1 of them bus off"})
    if (all.find(part) == std::string::npos)
      check::fail(__FILE__, __LINE__) << "no '" << part << "' in:\n" << all;
  CHECK_TEXT(can_error_text([] {
               CanFrame f;
               f.error = true;
               f.id = 0x44;
               return f;
             }()),
             "controller problem, bus off");
}

void states() {
  CHECK_TEXT(std::string(cia402_state(0x0637)), "operation enabled");
  CHECK_TEXT(std::string(cia402_state(0x0650)), "switch on disabled");
  CHECK_TEXT(std::string(cia402_state(0x0631)), "ready to switch on");
  CHECK_TEXT(std::string(cia402_state(0x0633)), "switched on");
  CHECK_TEXT(std::string(cia402_state(0x0617)), "quick stop active");
  CHECK_TEXT(std::string(cia402_state(0x0618)), "fault");
  CHECK_TEXT(std::string(cia402_state(0x061F)), "fault reaction active");
}

// A drive that told of a fault once, in either of its two states, is remarked on.
void a_fault_is_remembered() {
  for (const int told : {0x0237, 0x0218, 0x021F, 0x0217}) {
    std::string log;
    for (int i = 0; i < 20; ++i) {
      CanFrame frame;
      frame.t_ns = kStart + i * kPeriod;
      frame.id = 0x181;
      const std::int32_t counts = 10 * i;
      const std::int16_t current = 5;
      const auto status = static_cast<std::uint16_t>(i == 10 ? told : 0x0237);
      put(frame, 0, &counts, 4);
      put(frame, 4, &current, 2);
      put(frame, 6, &status, 2);
      log += candump_line(frame, "can0") + '\n';
    }
    const auto rows = rows_of(log, R"(period_s = 0.000125
signal,               frame, byte, type,   factor
spindle.angle_counts, 0x181, 0,    int32
spindle.current_A,    0x181, 4,    int16,  0.001
spindle.status_word,  0x181, 6,    uint16
)");
    if (!rows) return;
    TraceRow row;
    auto more = rows->next(row);
    while (more && *more) more = rows->next(row);
    std::string all;
    for (const std::string& remark : rows->remarks()) all += remark + '\n';
    const bool fault = told == 0x0218 || told == 0x021F;
    CHECK((all.find("reported a fault; its last state is 'operation enabled'") !=
           std::string::npos) == fault);
  }
}

// Every width and order against shifts by hand.
void fields() {
  const std::vector<std::uint8_t> data = {0x12, 0x34, 0x56, 0x78, 0x9A, 0xBC, 0xDE, 0xF0};
  using Kind = BitField::Kind;
  CHECK(raw_bits(data, {0, 16, Kind::unsigned_integer, false}) == 0x3412U);
  CHECK(raw_bits(data, {0, 16, Kind::unsigned_integer, true}) == 0x1234U);
  CHECK(raw_bits(data, {4, 12, Kind::unsigned_integer, false}) == 0x341U);
  CHECK(raw_bits(data, {8, 24, Kind::unsigned_integer, true}) == 0x345678U);
  CHECK(raw_bits(data, {0, 64, Kind::unsigned_integer, false}) == 0xF0DEBC9A78563412U);
  CHECK(number_of(*raw_bits(data, {60, 4, Kind::signed_integer, false}),
                  {60, 4, Kind::signed_integer, false}) == -1);
  CHECK(number_of(*raw_bits(data, {56, 4, Kind::signed_integer, false}),
                  {56, 4, Kind::signed_integer, false}) == 0);
  CHECK(!raw_bits(data, {57, 8, Kind::unsigned_integer, false}));
  const float f = -1.25F;
  std::vector<std::uint8_t> bytes(4);
  std::memcpy(bytes.data(), &f, 4);
  const BitField real{0, 32, Kind::real, false};
  CHECK(number_of(*raw_bits(bytes, real), real) == -1.25);
}

void maps() {
  const auto map = CanMap::parse(kPackedMap, "map");
  CHECK(map && map->messages.size() == 1 && map->messages[0].samples == 4 &&
        map->messages[0].every == 4 && map->messages[0].sequence && map->signals.size() == 4);
  malformed::check_all("can_map", 20, [](const std::string& path) {
    const auto bad = CanMap::read(path);
    return bad ? Error{} : bad.error();
  });
  const auto absent = CanMap::read("/no/such/map");
  CHECK(!absent && absent.error().kind == ErrorKind::device);
  for (const char* text : {"", "period_s = 0.001\n", "signal, frame, byte, type\n",
                           "period_s = 0.001\nsignal, frame, byte, type\n",
                           "signal, frame, byte, type\nx.current_A, 0x181, 0, int16\n"}) {
    const auto bad = CanMap::parse(text, "map");
    CHECK(!bad && bad.error().sentence.starts_with("map: "));
  }
}

}  // namespace

int main() {
  four_roads();
  told();
  states();
  a_fault_is_remembered();
  fields();
  maps();
  return check::done();
}
