// Signals of a DBC file: against values worked out by hand, a published example, and a slow decoder
// that walks the bits as the format numbers them; then through a CAN map to rows.
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <sstream>

#include "check.hpp"
#include "io/malformed.hpp"
#include "servosense/hal/candump_rows.hpp"

using namespace servosense;

namespace {

constexpr const char* kDrives = "tests/data/can/drives.dbc";

CanFrame frame_of(const std::string& line) {
  CandumpReader reader =
      CandumpReader::from_stream(std::make_unique<std::istringstream>(line + '\n'), "line");
  CanFrame frame;
  CHECK(*reader.next(frame));
  return frame;
}

// The value of a signal in a frame, in the file's units; NaN if the frame does not carry it.
double value(const Dbc& dbc, const std::string& path, const CanFrame& frame) {
  const auto found = dbc.find(path);
  if (!found || found->key != frame.key()) return std::nan("");
  const DbcSignal& s = found->signal;
  if (s.multiplexing && raw_bits(frame.bytes(), s.multiplexing->field) != s.multiplexing->value)
    return std::nan("");
  const auto raw = raw_bits(frame.bytes(), s.bits);
  return raw ? number_of(*raw, s.bits) * s.factor + s.offset : std::nan("");
}

void by_hand() {
  const auto dbc = Dbc::read(kDrives);
  CHECK(dbc);
  if (!dbc) return;
  CHECK(dbc->messages().size() == 8);
  struct Case {
    const char* frame;
    const char* signal;
    double value;
  };
  const double none = std::nan("");
  const Case cases[] = {
      // 0x84030201 = 2214789633 - 2^32; 0xFF38 = -200; 0xF9C = -100; 5.
      {"(1.0) can0 181#01020384FF389C5F", "SpindleState.Angle", -2080177663.0},
      {"(1.0) can0 181#01020384FF389C5F", "SpindleState.Current", -200 * 0.1},
      {"(1.0) can0 181#01020384FF389C5F", "SpindleState.Speed", -400},
      {"(1.0) can0 181#01020384FF389C5F", "SpindleState.Counter", 5},
      {"(1.0) can0 182#01020384FF389C5F", "SpindleState.Counter", none},
      {"(1.0) can0 00000181#01020384FF389C5F", "SpindleState.Counter", none},
      // Velocity 0x3830 of 14 bits = 14384 - 16384; position 1000000 tenths of um, 100 um off.
      {"(1.0) can0 182#383040420F000000", "FeedState.Page", 0},
      {"(1.0) can0 182#383040420F000000", "FeedState.Velocity", -1000},
      {"(1.0) can0 182#383040420F000000", "FeedState.Position", 99900},
      {"(1.0) can0 182#383040420F000000", "FeedState.Current", none},
      // 0xD12 = 3346 - 4096; 0x78 / 2 - 40.
      {"(1.0) can0 182#7830D12A78000000", "FeedState.Page", 1},
      {"(1.0) can0 182#7830D12A78000000", "FeedState.Velocity", -1000},
      {"(1.0) can0 182#7830D12A78000000", "FeedState.Current", -1500},
      {"(1.0) can0 182#7830D12A78000000", "FeedState.Temperature", 20},
      {"(1.0) can0 182#7830D12A78000000", "FeedState.Position", none},
      {"(1.0) can0 182#B8300000C03F0000", "FeedState.Torque", 1.5},
      // The double 1234 is 0x4093480000000000.
      {"(1.0) can0 18FF0001##0"
       "0000000000000000000000000000000000000000000000000000000000000000"
       "0000000000489340000000000000000000000000000000000000000000000000",
       "Diagnosis.Power", 1234 * 0.001}};
  for (const Case& c : cases) {
    const double got = value(*dbc, c.signal, frame_of(c.frame));
    ++check::checks;
    if (got != c.value && !(std::isnan(got) && std::isnan(c.value)))
      check::fail(__FILE__, __LINE__)
          << c.signal << " of " << c.frame << ": " << got << ", expected " << c.value << '\n';
  }
  CHECK_TEXT(dbc->find("FeedState.Temperature")->signal.unit,
             "\xB0"
             "C");  // Latin-1

  // The example of cantools' documentation: these three values make these eight bytes.
  const auto example = Dbc::parse(
      "BO_ 496 ExampleMessage: 8 PCM1\n"
      " SG_ Temperature : 0|12@0- (0.01,250) [229.53|270.47] \"degK\" PCM1,FOO\n"
      " SG_ AverageRadius : 6|6@0+ (0.1,0) [0|5] \"m\"\n"
      " SG_ Enable : 7|1@0+ (1,0) [0|0] \"-\" PCM1\n",
      "example.dbc");
  CHECK(example);
  if (!example) return;
  const CanFrame frame = frame_of("(1.0) can0 1F0#C001400000000000");
  CHECK_NEAR(value(*example, "ExampleMessage.Temperature", frame), 250.1, 1e-12);
  CHECK_NEAR(value(*example, "ExampleMessage.AverageRadius", frame), 3.2, 1e-12);
  CHECK(value(*example, "ExampleMessage.Enable", frame) == 1);
}

// Bits as the format numbers them: byte / 8, least significant first. A little-endian number goes
// up from its least significant bit; a big-endian one goes down from its most significant bit, and
// from bit 0 of a byte to bit 7 of the next.
double walked(const std::vector<std::uint8_t>& data, unsigned start, unsigned bits, bool big,
              bool is_signed) {
  std::vector<bool> number;  // the least significant bit first
  int at = static_cast<int>(start);
  for (unsigned i = 0; i < bits; ++i) {
    number.push_back((data[static_cast<std::size_t>(at) / 8] >> (at % 8) & 1) != 0);
    at += !big ? 1 : at % 8 == 0 ? 15 : -1;
  }
  if (big) number = {number.rbegin(), number.rend()};
  double sum = 0;  // exact: at most 53 bits
  for (unsigned i = 0; i < bits; ++i)
    if (number[i]) sum += std::ldexp(is_signed && i + 1 == bits ? -1.0 : 1.0, static_cast<int>(i));
  return sum;
}

void by_walking() {
  constexpr unsigned kSeed = 17;
  std::mt19937 random(kSeed);
  const auto up_to = [&](unsigned n) { return static_cast<unsigned>(random() % (n + 1)); };
  int worst = 0;
  for (int n = 0; n < 4000; ++n) {
    const unsigned bytes = 1 + up_to(63);
    const unsigned bits = 1 + up_to(std::min(52U, 8 * bytes - 1));
    const bool big = up_to(1) == 1, is_signed = up_to(1) == 1;
    // A big-endian number is as far from the end as a little-endian one from the beginning,
    // counted in the order in which it goes through the bytes.
    const unsigned room = up_to(8 * bytes - bits);
    const unsigned start = big ? room / 8 * 8 + 7 - room % 8 : room;
    std::ostringstream text;
    text << "BO_ " << n % 2048 << " M: " << bytes << " A\n SG_ S : " << start << '|' << bits << '@'
         << (big ? 0 : 1) << (is_signed ? '-' : '+') << " (1,0) [0|0] \"\" A\n";
    const auto dbc = Dbc::parse(text.str(), "m.dbc");
    CanFrame frame;
    frame.id = static_cast<std::uint32_t>(n % 2048);
    frame.length = static_cast<std::uint8_t>(bytes);
    for (unsigned i = 0; i < bytes; ++i) frame.data[i] = static_cast<std::uint8_t>(random());
    const std::vector<std::uint8_t> data(frame.data.begin(), frame.data.begin() + bytes);
    const double expected = walked(data, start, bits, big, is_signed);
    ++check::checks;
    if ((!dbc || value(*dbc, "M.S", frame) != expected) && worst++ < 3)
      check::fail(__FILE__, __LINE__) << "seed " << kSeed << ", case " << n << ": " << text.str();
    // One byte less, and the number is not in the frame, or it is the same.
    frame.length = static_cast<std::uint8_t>(bytes - 1);
    const double shorter = dbc ? value(*dbc, "M.S", frame) : 0;
    const unsigned last = room + bits - 1;
    CHECK(last / 8 < bytes - 1 ? shorter == expected : std::isnan(shorter));
  }
}

std::string drives_text() {
  std::ifstream in(kDrives, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

constexpr const char* kMap = R"(period_s = 0.001
dbc = drives.dbc
signal,               dbc,                   factor,    every
sequence,             SpindleState.Counter
spindle.angle_counts, SpindleState.Angle
spindle.current_A,    SpindleState.Current,  0.01*12.5
spindle.speed_rad_s,  SpindleState.Speed
x.velocity_m_s,       FeedState.Velocity
x.position_m,         FeedState.Position,    ,          3
x.current_A,          FeedState.Current,     ,          3
x.temperature_C,      FeedState.Temperature, ,          3
x.torque_Nm,          FeedState.Torque,      ,          3
)";

// Two drives, one of which says three things in turn, as rows: every value in its row, in the units
// of its column, and no value in the others.
void rows_of_a_map() {
  auto map = CanMap::parse(kMap, "drives.map", drives_text());
  if (!map) check::fail(__FILE__, __LINE__) << map.error().sentence << '\n';
  CHECK(map && map->messages.size() == 5);
  if (!map) return;
  constexpr std::size_t kRows = 3000;
  std::mt19937 random(23);
  std::vector<std::int32_t> angle, position;
  std::vector<std::int16_t> current, speed, velocity, feed_current;
  std::string log;
  char line[80];
  for (std::size_t n = 0; n < kRows; ++n) {
    angle.push_back(static_cast<std::int32_t>(random()));
    position.push_back(static_cast<std::int32_t>(random()));
    current.push_back(static_cast<std::int16_t>(random()));
    speed.push_back(static_cast<std::int16_t>(static_cast<int>(random() % 4096) - 2048));
    velocity.push_back(static_cast<std::int16_t>(static_cast<int>(random() % 16384) - 8192));
    feed_current.push_back(static_cast<std::int16_t>(static_cast<int>(random() % 4096) - 2048));
    const auto a = static_cast<std::uint32_t>(angle[n]),
               p = static_cast<std::uint32_t>(position[n]);
    const auto s = static_cast<unsigned>(speed[n]) & 0xFFFU;
    std::snprintf(line, sizeof line, "(%zu.%06zu) can0 181#%02X%02X%02X%02X%04X%02X%02X\n",
                  1 + n / 1000, n % 1000 * 1000, a & 255U, a >> 8U & 255U, a >> 16U & 255U,
                  a >> 24U, static_cast<unsigned>(current[n]) & 0xFFFFU, s & 255U,
                  s >> 8U | static_cast<unsigned>(n % 16) << 4U);
    log += line;
    const unsigned head =
        (static_cast<unsigned>(n % 3) << 14U) | (static_cast<unsigned>(velocity[n]) & 0x3FFFU);
    unsigned long long body = 0;
    if (n % 3 == 0)
      body = (p & 255ULL) << 40U | (p >> 8U & 255ULL) << 32U | (p >> 16U & 255U) << 24U |
             (p >> 24U & 255U) << 16U;
    else if (n % 3 == 1)
      body = (static_cast<unsigned long long>(feed_current[n]) & 0xFFFULL) << 36U |
             static_cast<unsigned long long>(n % 256) << 24U;
    else
      body = 0x0000C03F0000ULL;
    std::snprintf(line, sizeof line, "(%zu.%06zu) can0 182#%04X%012llX\n", 1 + n / 1000,
                  n % 1000 * 1000 + 100, head, body);
    log += line;
  }
  CandumpRows rows(CandumpReader::from_stream(std::make_unique<std::istringstream>(log), "log"),
                   std::move(*map));
  TraceRow row;
  std::size_t n = 0;
  std::array<std::size_t, 3> wrong{};
  while (true) {
    const auto more = rows.next(row);
    CHECK(more);
    if (!more || !*more || n >= kRows) break;
    const auto& f = row.fields;
    // The factors as the map multiplies them out: the file's first.
    const double rad_s = 4 * (kTwoPi / 60), amps = 0.1 * (0.01 * 12.5);
    wrong[0] += f[0].counts != angle[n] || f[1].value != current[n] * amps ||
                f[2].value != speed[n] * rad_s || f[3].value != velocity[n] * (0.5 * 1e-3);
    const bool carried[] = {n % 3 == 0, n % 3 == 1, n % 3 == 1, n % 3 == 2};
    for (std::size_t i = 0; i < 4; ++i)
      wrong[1] += (f[4 + i].state == TraceField::State::value) != carried[i] ||
                  f[4 + i].state == TraceField::State::invalid;
    if (carried[0]) wrong[2] += f[4].value != position[n] * (0.1 * 1e-6) + -100 * 1e-6;
    if (carried[1])
      wrong[2] += f[5].value != feed_current[n] * (2 * 1e-3) ||
                  f[6].value != static_cast<double>(n % 256) * 0.5 - 40;
    if (carried[3]) wrong[2] += f[7].value != 1.5;
    ++n;
  }
  CHECK(n == kRows);
  CHECK(wrong[0] == 0 && wrong[1] == 0 && wrong[2] == 0);
  for (const std::string& remark : rows.remarks()) std::printf("  %s\n", remark.c_str());
  CHECK(rows.remarks().empty());
}

std::string refusal(const std::string& row, const std::string& heading = "signal, dbc, factor") {
  const auto map = CanMap::parse("period_s = 0.001\ndbc = drives.dbc\n" + heading + '\n' + row, "m",
                                 drives_text());
  return map ? "" : map.error().sentence;
}

void units() {
  struct Case {
    const char* unit;
    const char* column;
    double value;  // of one; 0: the map must say
  };
  const Case cases[] = {{"rpm", "spindle.speed_rad_s", 2 * M_PI / 60},
                        {"1/min", "spindle.speed_rad_s", 2 * M_PI / 60},
                        {"min^-1", "spindle.speed_rad_s", 2 * M_PI / 60},
                        {"deg/s", "spindle.speed_rad_s", M_PI / 180},
                        {"\xB0/s", "spindle.speed_rad_s", M_PI / 180},
                        {"\xC2\xB0", "spindle.angle_rad", M_PI / 180},
                        {"mm", "x.position_m", 1e-3},
                        {"\xB5m", "x.position_m", 1e-6},
                        {"\xC2\xB5m", "x.position_m", 1e-6},
                        {"mm/min", "x.velocity_m_s", 1e-3 / 60},
                        {"m / s^2", "x.acceleration_m_s2", 1},
                        {"mm/s\xC2\xB2", "x.acceleration_m_s2", 1e-3},
                        {"mA", "x.current_A", 1e-3},
                        {"N.m", "x.torque_Nm", 1},
                        {"N m", "x.torque_Nm", 1},
                        {"kN", "x.force_N", 1e3},
                        {"kW", "spindle.power_W", 1e3},
                        {"\xB0"
                         "C",
                         "x.temperature_C", 1},
                        {"", "x.current_A", 0},
                        {"%", "x.current_A", 0},
                        {"A", "x.torque_Nm", 0},
                        {"mm", "spindle.speed_rad_s", 0},
                        {"MA", "x.current_A", 0},
                        {"degF", "x.temperature_C", 0},
                        {"", "machine.nc_block", 0}};
  for (const Case& c : cases) {
    const std::string dbc =
        std::string("BO_ 1 M: 2 A SG_ S : 0|16@1- (1,0) [0|0] \"") + c.unit + "\" A";
    const std::string head = "period_s = 0.001\ndbc = d\nsignal, dbc, factor\n";
    const auto map = CanMap::parse(head + c.column + ", M.S\n", "m", dbc);
    const auto told = CanMap::parse(head + c.column + ", M.S, 7\n", "m", dbc);
    CHECK(told && told->messages[0].fields[0].factor == 7);
    ++check::checks;
    if (c.value != 0
            ? !map || std::abs(map->messages[0].fields[0].factor / c.value - 1) > 1e-15
            : map || map.error().sentence.find("what one of the former") == std::string::npos)
      check::fail(__FILE__, __LINE__) << c.unit << " for " << c.column << '\n';
  }
}

void refused() {
  const std::pair<const char*, const char*> cases[] = {
      {"x.current_A, FeedState.Late, 1", "a value that the multiplexer cannot have"},
      {"x.power_W, Diagnosis.Half, 1", "value type 1 and 16 bits"},
      {"x.voltage_V, Diagnosis.Beyond", "beyond the 64 bytes of its message"},
      {"x.voltage_V, Diagnosis.Nothing", "factor of 0"},
      {"x.current_A, Nested.Deep", "several multiplexers or ranges"},
      {"x.current_A, Nested.Inner, 1", "several multiplexers or ranges"},
      {"x.current_A, Ranges.Many", "several multiplexers or ranges"},
      {"x.current_A, Ranges.2nd", "several multiplexers or ranges"},
      {"x.current_A, Ranges.One", "say with 'every'"},
      {"x.current_A, Headless.Orphan", "has no multiplexer"},
      {"x.current_A, Long.Far", "in a message of 200 bytes"},
      {"x.current_A, VECTOR__INDEPENDENT_SIG_MSG.Free", "belongs to no frame"},
      {"x.current_A, SpindelState.Current, 1", "the nearest is 'SpindleState'"},
      {"x.current_A, NotAMessage.Current, 1", "no message 'NotAMessage'"},
      {"x.current_A, SpindleState.Curent, 1", "the nearest is 'Current'"},
      {"x.current_A, Current, 1", "expected MESSAGE.SIGNAL of drives.dbc, found 'Current'"},
      {"x.current_A, SpindleState.Current", "is in '%', x.current_A in 'A'; write in the column"},
      {"spindle.angle_counts, SpindleState.Speed", "counts are whole numbers"},
      {"sequence, SpindleState.Speed", "uint1 to uint32"}};
  for (const auto& [row, fragment] : cases) {
    const std::string sentence = refusal(row);
    ++check::checks;
    if (!sentence.starts_with("m:4: ") || sentence.find(fragment) == std::string::npos)
      check::fail(__FILE__, __LINE__) << row << ": got \"" << sentence << "\"\n";
  }
  CHECK(refusal("spindle.speed_rad_s, SpindleState.Speed\n") == "");
  CHECK(refusal("x.current_A, Ranges.One, 2\n", "signal, dbc, every") == "");
  CHECK(refusal("x.current_A, 0x181, SpindleState.Speed\n", "signal, frame, dbc") ==
        "m:4: give either frame, byte and type, or dbc");
  // A row of the common form under the same heading.
  CHECK(refusal("x.current_A, 0x181, 0, int16\n", "signal, frame, byte, type, dbc") == "");
  const auto unnamed = CanMap::parse("period_s = 1\nsignal, dbc\nx.current_A, M.S\n", "m");
  CHECK(!unnamed && unnamed.error().sentence.starts_with("m:3: no DBC file is named"));
  // A file that is not there, or is none, beside the map.
  const auto absent = CanMap::read("tests/data/can/dbc_absent.map");
  CHECK(!absent && absent.error().kind == ErrorKind::device &&
        absent.error().sentence.starts_with("tests/data/can/none.dbc: cannot be "));
}

void malformed_files() {
  malformed::check_all("dbc", 30, [](const std::string& path) {
    const auto bad = Dbc::read(path);
    return bad ? Error{} : bad.error();
  });
  const auto absent = Dbc::read("/no/such.dbc");
  CHECK(!absent && absent.error().kind == ErrorKind::device);
  const auto empty = Dbc::parse("", "empty.dbc");
  CHECK(empty && empty->messages().empty() && !empty->find("M.S"));
  // Byte order mark, no NS_, all in one line, names of nodes left out.
  const auto terse = Dbc::parse(
      "\xEF\xBB\xBF"
      "NS_: CM_ BA_ BS_: BU_: BO_ 1 M: 2 SG_ S : 0|16@1-(1,0)[|]\"\""
      "BO_ 2147483649 N: 0 A VAL_ 1 S 0 \"a;b\";",
      "terse.dbc");
  CHECK(terse && terse->messages().size() == 2 && terse->find("M.S") &&
        terse->messages()[1].key == 0x80000001U);
}

}  // namespace

int main() {
  by_hand();
  by_walking();
  rows_of_a_map();
  units();
  refused();
  malformed_files();
  return check::done();
}
