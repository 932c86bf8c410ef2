// Foreign tables: encodings, separators, decimal marks, headings, and what is no table.
#include <array>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/io/table_file.hpp"
#include "servosense/io/time_stamp.hpp"
#include "servosense/io/unit_name.hpp"

using namespace servosense;

namespace {

Expected<TableFile> table_of(const std::string& text, const TableOptions& options = {}) {
  return TableFile::from_stream(std::make_unique<std::istringstream>(text), "scope.csv", options);
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) text += (i == 0 ? "" : "|") + words[i];
  return text;
}

/// Rows as "a|b|c" lines; an error as its sentence.
std::string rows_of(TableFile& file) {
  std::string text;
  for (TableRow row;;) {
    const auto more = file.next(row);
    if (!more) return more.error().sentence;
    if (!*more) return text;
    text += joined({row.fields.begin(), row.fields.end()}) + "\n";
  }
}

struct Read {
  std::string headings, units, rows;
};
Read read(const std::string& text) {
  auto file = table_of(text);
  CHECK(file.has_value());
  if (!file) {
    std::cout << file.error().sentence << '\n';
    return {};
  }
  return {joined(file->layout().headings), joined(file->layout().units), rows_of(*file)};
}

void refused(const std::string& text, const std::string& part) {
  auto file = table_of(text);
  std::string sentence = file ? rows_of(*file) : file.error().sentence;
  if (sentence.find(part) == std::string::npos) CHECK_TEXT(sentence, part);
  CHECK(sentence.starts_with("scope.csv"));
}

void test_separators() {
  const std::string rows = "0|1.5|2\n1|1.6|3\n2|1.7|4\n";
  for (const char* separator : {",", ";", "\t", "|", "  ", " ", ", "}) {
    std::string text;
    for (const char* row : {"t", "v", "w"})
      text += (text.empty() ? "" : separator) + std::string(row);
    for (const auto& row : {std::array{"0", "1.5", "2"}, {"1", "1.6", "3"}, {"2", "1.7", "4"}})
      text += "\r\n" + std::string(row[0]) + separator + row[1] + separator + row[2];
    const Read found = read(text);
    CHECK_TEXT(found.headings, "t|v|w");
    CHECK_TEXT(found.rows, rows);
  }
  // Carriage returns alone, separators at the ends of rows, no last line end.
  CHECK_TEXT(read("t;v\r0;1.5\r1;1.6\r2;1.7").rows, "0|1.5\n1|1.6\n2|1.7\n");
  CHECK_TEXT(read("t;v;\n0;1,5;\n1;1,6;\n2;1,7;\n").rows, "0|1,5\n1|1,6\n2|1,7\n");
  // A date and a clock stand in one field of tabs, in two of blanks.
  CHECK_TEXT(read("t\tv\n2024-05-01 12:00:00\t1\n2024-05-01 12:00:01\t2\n").headings, "t|v");
}

void test_headings() {
  const Read found =
      read("Recording 7\nMachine;Mill\nt;Speed;\"Strom;\nX\"\nms;1/min;A\n0;1;2\n1;2;3\n2;3;4\n");
  CHECK_TEXT(found.headings, "t|Speed|Strom;\nX");
  CHECK_TEXT(found.units, "ms|1/min|A");
  CHECK_TEXT(read("# t,v\n0,1.5\n1,1.6\n2,1.7\n").headings, "t|v");
  CHECK_TEXT(read("s  mm\n0  1.5\n1  1.6\n2  1.7\n").headings, "s|mm");
  CHECK_TEXT(read("Spindle speed   X pos\n0   1.5\n1  1.6\n2  1.7\n").headings,
             "Spindle speed|X pos");
  CHECK_TEXT(read("t;[ms];bar\ns;A;bar\n0;1;2\n1;2;3\n").units, "s|A|bar");
  CHECK_TEXT(read("v\tt\n%\tms\n1\t0\n1\t1\n").units, "%|ms");
  CHECK_TEXT(read("t\tv\tw\n\t%\tA\n1\t0\t1\n1\t1\t1\n").units, "|%|A");
  const auto none = table_of("1 2.5\n2 2.5\n3 2.5\n");
  CHECK(none && !none->layout().has_heading && none->layout().first_line == 1);
  CHECK_TEXT(read("a;b\n\"say \"\"x\"\";\";1\n\"2\";3\n4;5\n").rows, "say \"x\";|1\n2|3\n4|5\n");
}

void test_encodings() {
  const std::string latin = "t;Weg [\xB5m];\xC4 [\xB0]\n0;1,5;2\n1;1,6;3\n";
  CHECK_TEXT(read(latin).headings, "t|Weg [\xC2\xB5m]|\xC3\x84 [\xC2\xB0]");
  CHECK_TEXT(read("\xEF\xBB\xBFt;v\n0;1\n1;2\n").headings, "t|v");
  for (const bool little : {true, false}) {
    std::string wide = little ? "\xFF\xFE" : "\xFE\xFF";
    for (const unsigned code : {0x74U, 0x3BU, 0xB5U, 0xD83DU, 0xDE00U, 0x0DU, 0x0AU, 0x30U, 0x3BU,
                                0x31U, 0x0AU, 0x31U, 0x3BU, 0x32U, 0x0AU}) {
      const char low = static_cast<char>(code & 0xFFU), high = static_cast<char>(code >> 8U);
      wide += little ? std::string{low, high} : std::string{high, low};
    }
    CHECK_TEXT(read(wide).headings, "t|\xC2\xB5\xF0\x9F\x98\x80");
    CHECK_TEXT(read(wide).rows, "0|1\n1|2\n");
    // Without the mark at its start.
    CHECK_TEXT(read(wide.substr(2)).rows, "0|1\n1|2\n");
  }
}

void test_numbers() {
  const auto is = [](const char* field, DecimalMark mark, double value) {
    const TableNumber number = table_number(field, mark);
    CHECK(number.state == TableNumber::State::value);
    CHECK_NEAR(number.value, value, 0);
  };
  constexpr auto kPoint = DecimalMark::point, kComma = DecimalMark::comma;
  is("1,234.5", kPoint, 1234.5);
  is("1.234,5", kComma, 1234.5);
  is("-1.234.567", kComma, -1234567);
  is("1'234.5", kPoint, 1234.5);
  is("1 234,5", kComma, 1234.5);
  is("1\xC2\xA0"
     "234,5",
     kComma, 1234.5);
  is("+1,98E+02", kComma, 198);
  is(".5", kPoint, 0.5);
  is("\xE2\x88\x92"
     "3",
     kPoint, -3);
  for (const char* word : {"NaN", "n/a", "---", "-", "#N/A", "inf", "1.#IND"})
    CHECK(table_number(word, kPoint).state == TableNumber::State::invalid);
  for (const char* word : {"1,23", "1,2345", "12,34,567", "abc", "1.2.3", "1e", "12 mm", "0x1F"})
    CHECK(table_number(word, kPoint).state == TableNumber::State::text);
  CHECK(table_number("", kPoint).state == TableNumber::State::empty);
}

void test_decimal_marks() {
  const auto layout = [](const std::string& rows) {
    const auto file = table_of("t;v\n" + rows);
    CHECK(file.has_value());
    return file ? file->layout() : TableLayout{};
  };
  CHECK(layout("0;1,5\n1;1,6\n").mark == DecimalMark::comma);
  CHECK(layout("0;1.5\n1;1.6\n").mark == DecimalMark::point);
  // Thousands beside something that tells; a number of thousands does not begin with a zero.
  const TableLayout english = layout("0;1,500\n1;2,600.5\n");
  CHECK(english.mark == DecimalMark::point && !english.mark_is_open);
  const TableLayout german = layout("0;1.500\n1;0,6\n");
  CHECK(german.mark == DecimalMark::comma && !german.mark_is_open);
  CHECK(!layout("0;0,600\n1;1,500\n").mark_is_open);
  const TableLayout open = layout("0;1,500\n1;2,600\n2;3,100\n");
  CHECK(open.mark_is_open);
  CHECK_TEXT(open.open_example, "1,500");
  CHECK(layout("0;1.500\n1;2.600\n").mark_is_open);
}

void test_refusals() {
  refused("", "the file is empty");
  refused("\n\n  \n", "the file is empty");
  refused("words and words\nmore of them\n", "no table of numbers");
  refused(std::string("\x7F"
                      "ELF\x01\0\0\x02;1;2\n",
                      14),
          "no text");
  refused("Strom\n1,5\n1,6\n1,7\n", "decimal commas cannot be told");
  refused("t;v\n0;1\n\"1;2\n2;3\n", "scope.csv:3: a quotation mark opens");
  std::string ragged = "t;v\n";
  for (int i = 0; i < 100; ++i) ragged += std::to_string(i) + (i % 5 == 2 ? ";1;1\n" : ";1\n");
  refused(ragged, "scope.csv:4: expected 2 fields, found 3, and so in 11 rows");
  refused("t;v\n0;1,5\n1;1.55\n2;1,5\n3;1.55\n", "decimal points (2) and decimal commas (2)");
}

void test_few_ragged_rows() {
  auto file = table_of("t;v\n0;1\n1;1\n2;1\noverrun\n3;1\n# mark\n\nt;v\n4;1\nEOF\n");
  CHECK(file.has_value());
  if (!file) return;
  CHECK_TEXT(rows_of(*file), "0|1\n1|1\n2|1\n3|1\n4|1\n");
  CHECK(file->ragged().count == 3 && file->ragged().line == 5 && file->ragged().fields == 1);
  CHECK(file->rewind().has_value());
  CHECK_TEXT(rows_of(*file), "0|1\n1|1\n2|1\n3|1\n4|1\n");
}

void test_time_stamps() {
  // 2024-05-01 is day 19844 since 1970.
  constexpr Nanoseconds kDay = 19844 * 86400 * kNanosecondsPerSecond;
  constexpr Nanoseconds kNoon = 43200 * kNanosecondsPerSecond + 125'000'000;
  const auto is = [](const char* text, TimeStamp::Kind kind, Nanoseconds t_ns) {
    const auto stamp = time_stamp_from(text);
    CHECK(stamp && stamp->kind == kind && stamp->t_ns == t_ns);
    if (!stamp || stamp->t_ns != t_ns) std::cout << "  " << text << '\n';
  };
  using Kind = TimeStamp::Kind;
  for (const char* text :
       {"2024-05-01T12:00:00.125", "2024-05-01 12:00:00,125", "2024/05/01 12:00:00.125",
        "01.05.2024 12:00:00,125", "2024-05-01T14:00:00.125+02:00", "2024-05-01T12:00:00.125Z",
        "2024-05-01 12:00:00:125", "1.5.2024 12:00:00.125"})
    is(text, Kind::date_and_clock, kDay + kNoon);
  is("2024-05-01", Kind::date, kDay);
  is("12:00:00.125", Kind::clock, kNoon);
  is("12:00:00.125 PM", Kind::clock, kNoon);
  is("12:00:00.123456789", Kind::clock, 43200 * kNanosecondsPerSecond + 123456789);
  for (const char* text : {"1.5", "12:30", "2024-13-01", "2024-02-30", "25:00:00", "12:00:00x",
                           "1.2.3.4", "2024-05-01T12", "12345"})
    CHECK(!time_stamp_from(text));
  CHECK_TEXT(date_text(kDay + kNoon), "2024-05-01T12:00:00.125");
}

void test_units() {
  const auto value = [](const char* text, Dimension dimension) {
    const auto unit = unit_named(text);
    CHECK(unit && unit->dimension == dimension);
    return unit ? unit->value : 0;
  };
  CHECK_NEAR(value("1/min", Dimension::angular_speed), kTwoPi / 60, 0);
  CHECK_NEAR(value("min\xE2\x81\xBB\xC2\xB9", Dimension::angular_speed), kTwoPi / 60, 0);
  CHECK_NEAR(value("\xC2\xB5m", Dimension::length), 1e-6, 0);
  CHECK_NEAR(value("\xB0/s", Dimension::angular_speed), kPi / 180, 0);
  CHECK_NEAR(value("m/s\xC2\xB2", Dimension::acceleration), 1, 0);
  CHECK_NEAR(value("N m", Dimension::torque), 1, 0);
  CHECK_NEAR(value("nm", Dimension::length), 1e-9, 0);
  CHECK_NEAR(value("KW", Dimension::power), 1e3, 0);
  CHECK(!unit_named("MA") && unit_named("MM/MIN") && !value_of_unit("KW", Quantity::power_W));
  CHECK(!unit_named("NM") && unit_named("NM", Dimension::torque));
  CHECK(!unit_named("in") && !unit_named("bar"));
  CHECK_TEXT(std::string(nearest_unit("rpn")), "rpm");
  CHECK_NEAR(*value_of_unit("%", Quantity::feed_override), 0.01, 0);
  CHECK(!value_of_unit("mm", Quantity::current_A));
}

}  // namespace

int main() {
  test_separators();
  test_headings();
  test_encodings();
  test_numbers();
  test_decimal_marks();
  test_refusals();
  test_few_ragged_rows();
  test_time_stamps();
  test_units();
  return check::done();
}
