// The JSON writer, and the words and numbers it shares with the readers.
#include <cstdint>
#include <limits>
#include <random>
#include <sstream>
#include <string>

#include "check.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/text.hpp"

using namespace servosense;

namespace {

template <typename Write>
std::string written(Write write, int indent = 0) {
  std::ostringstream out;
  JsonWriter json(out, indent);
  write(json);
  return std::move(out).str();
}

std::string value(auto content) {
  return written([&](JsonWriter& json) { json.value(content); });
}

void test_values() {
  CHECK_TEXT(value(0.1), "0.1");
  CHECK_TEXT(value(-2.1e-5), "-2.1e-05");
  CHECK_TEXT(value(1e300), "1e+300");
  CHECK_TEXT(value(std::numeric_limits<double>::quiet_NaN()), "null");
  CHECK_TEXT(value(-std::numeric_limits<double>::infinity()), "null");
  CHECK_TEXT(value(std::numeric_limits<std::int64_t>::min()), "-9223372036854775808");
  CHECK_TEXT(value(std::numeric_limits<std::uint64_t>::max()), "18446744073709551615");
  CHECK_TEXT(value(true), "true");
  CHECK_TEXT(value(nullptr), "null");
  CHECK_TEXT(value("a\"b\\c\n\r\t\x01\x1f/"), "\"a\\\"b\\\\c\\n\\r\\t\\u0001\\u001f/\"");
  CHECK_TEXT(value(std::string("a\0b", 3)), "\"a\\u0000b\"");
  CHECK_TEXT(value("\xC2\xB5m \xF0\x9F\x98\x80"), "\"\xC2\xB5m \xF0\x9F\x98\x80\"");
  // Latin-1, an overlong slash, half a surrogate: not UTF-8, so U+FFFD for each byte.
  const std::string bad = "\xEF\xBF\xBD";
  CHECK_TEXT(value("\xB5m"), "\"" + bad + "m\"");
  CHECK_TEXT(value("\xC0\xAF"), "\"" + bad + bad + "\"");
  CHECK_TEXT(value("\xED\xA0\x80"), "\"" + bad + bad + bad + "\"");

  for (std::uint64_t seed = 1; seed <= 2000; ++seed) {
    std::mt19937_64 random(seed);
    const double mantissa = static_cast<double>(random() >> 11U);
    const double number = std::ldexp(mantissa, static_cast<int>(random() % 2000) - 1000);
    if (!std::isfinite(number)) continue;
    // The C library as the oracle.
    ++check::checks;
    if (std::strtod(value(number).c_str(), nullptr) != number)
      check::fail(__FILE__, __LINE__) << "number of seed " << seed << '\n';
  }
}

void test_structure() {
  const auto write = [](JsonWriter& json) {
    json.begin_object();
    json.member("channel", "x");
    json.key("effects");
    json.begin_array();
    json.begin_object();
    json.member("name", std::string("backlash"));
    json.member("seen", true);
    json.end_object();
    json.value(3);
    json.begin_array();
    json.end_array();
    json.end_array();
    json.key("none");
    json.begin_object();
    json.end_object();
    json.end_object();
  };
  CHECK_TEXT(
      written(write),
      R"({"channel": "x", "effects": [{"name": "backlash", "seen": true}, 3, []], "none": {}})");
  CHECK_TEXT(written(write, 2), R"({
  "channel": "x",
  "effects": [
    {
      "name": "backlash",
      "seen": true
    },
    3,
    []
  ],
  "none": {}
}
)");
}

void test_words() {
  // Textbook distances, in half changes; case counts half.
  CHECK(edit_distance("kitten", "sitting") == 6);
  CHECK(edit_distance("", "abc") == 6);
  CHECK(edit_distance("abc", "") == 6);
  CHECK(edit_distance("lead_m", "Lead_m") == 1);
  CHECK(edit_distance("same", "same") == 0);
  CHECK_TEXT(printable("a\nb\x7f\xC2\x85\xE2\x82\xAC"), "a\\x0ab\\x7f\\xc2\\x85\xE2\x82\xAC");
  CHECK(printable(std::string(1000, 'x')).size() == 63);
  CHECK(is_shown_as_written("Fr\xC3\xA4se 3") && is_shown_as_written(""));
  for (const char* bad : {"Fr\xE4se", "\x1b[31mred", "a\tb", "\xC2\x9B"})
    CHECK(!is_shown_as_written(bad));

  CHECK_TEXT(printed(0.00123456), "0.001235");
  CHECK_TEXT(printed(-123456.0, 3), "-1.23e+05");
  CHECK_TEXT(printed(2.0 / 3, 17), "0.66666666666666663");
  CHECK_TEXT(printed(1e-300 * 1e-300), "0");
  CHECK_TEXT(printed(std::numeric_limits<double>::quiet_NaN()), "nan");

  CHECK(parse_number("+1.5e3").value == 1500);
  CHECK(parse_number("-0x1").fault == NumberFault::not_a_number);
  CHECK(parse_number("").fault == NumberFault::not_a_number);
  CHECK(parse_number("+").fault == NumberFault::not_a_number);
  CHECK(parse_number("1e400").fault == NumberFault::out_of_range);
  CHECK(parse_number("-inf").fault == NumberFault::infinite);
  CHECK(parse_number("nan").fault == NumberFault::not_a_number);
  CHECK(parse_number("5e-324").value == std::numeric_limits<double>::denorm_min());
  CHECK(spells_nan("NaN") && spells_nan("-nan") && !spells_nan("nan(1)") && !spells_nan("na"));
}

}  // namespace

int main() {
  test_values();
  test_structure();
  test_words();
  return check::done();
}
