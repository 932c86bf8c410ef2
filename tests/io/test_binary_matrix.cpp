// Binary matrices: numbers as they were written by the test, the text that import reads, refusals.
#include <unistd.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/io/binary_matrix.hpp"
#include "servosense/io/table_file.hpp"

using namespace servosense;

namespace {

const std::filesystem::path folder =
    std::filesystem::temp_directory_path() / ("servosense_matrix_" + std::to_string(getpid()));

std::string put(const std::string& header, const std::vector<float>& numbers,
                std::size_t more_bytes = 0) {
  std::ofstream(folder / "a.hdr") << header;
  std::ofstream out(folder / "a.f32", std::ios::binary);
  for (const float number : numbers) {
    const auto bits = std::bit_cast<std::uint32_t>(number);
    for (unsigned shift = 0; shift < 32; shift += 8)
      out.put(static_cast<char>(bits >> shift & 0xffU));
  }
  for (std::size_t i = 0; i < more_bytes; ++i) out.put('x');
  return (folder / "a.f32").string();
}

const std::string kHeader =
    "format: float32 little-endian, interleaved (sample-major), no file header\nsamples: 3\n"
    "channels: 2\nfs_hz: 500\nchannel 0: speed_main [rpm] of the \"main\" spindle\n"
    "channel 1: load [A, rms]\nstart: in the morning\n";
const std::vector<float> kNumbers{0.1F,     -2.5e-7F,      3000,
                                  1.0F / 3, std::nanf(""), std::numeric_limits<float>::max()};

void numbers() {
  const std::string path = put(kHeader, kNumbers);
  for (const std::string& name : {path, (folder / "a.hdr").string()}) {
    auto matrix = BinaryMatrix::open(name);
    CHECK(matrix.has_value());
    if (!matrix) return;
    const MatrixHeader& header = matrix->header();
    CHECK(header.channels.size() == 2 && header.rows == 3 && header.rate_hz == 500);
    CHECK_TEXT(header.channels[0].name, "speed_main");
    CHECK_TEXT(header.channels[0].unit, "rpm");
    CHECK_TEXT(header.channels[0].remark, "of the \"main\" spindle");
    CHECK_TEXT(header.channels[1].unit, "A, rms");
    CHECK(header.remarks == std::vector<std::string>{"start: in the morning"});
    for (int pass = 0; pass < 2; ++pass) {
      std::array<float, 2> row{};
      for (std::size_t i = 0; i < 3; ++i) {
        const auto more = matrix->next(row);
        CHECK(more && *more);
        for (std::size_t k = 0; k < 2; ++k)
          CHECK(std::bit_cast<std::uint32_t>(row[k]) ==
                std::bit_cast<std::uint32_t>(kNumbers[2 * i + k]));
      }
      const auto end = matrix->next(row);
      CHECK(end && !*end);
      CHECK(matrix->rewind().has_value());
    }
  }
}

void as_a_table() {
  auto file = TableFile::open(put(kHeader, kNumbers));
  CHECK(file.has_value());
  if (!file) return;
  CHECK(file->layout().headings ==
        (std::vector<std::string>{"t_s", "speed_main [rpm]", "load [A, rms]"}));
  for (int pass = 0; pass < 2; ++pass) {
    TableRow row;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto more = file->next(row);
      CHECK(more && *more && row.fields.size() == 3);
      if (!more || !*more || row.fields.size() != 3) return;
      CHECK_NEAR(table_number(row.fields[0], DecimalMark::point).value,
                 static_cast<double>(i) / 500, 0);
      for (std::size_t k = 0; k < 2; ++k) {
        const TableNumber number = table_number(row.fields[1 + k], DecimalMark::point);
        const float original = kNumbers[2 * i + k];
        // All digits: the same float comes back.
        if (std::isnan(original))
          CHECK(number.state == TableNumber::State::invalid);
        else
          CHECK(static_cast<float>(number.value) == original);
      }
    }
    CHECK(!*file->next(row));
    CHECK(file->rewind().has_value());
  }
  // No rate, or a time of its own: no time is made.
  for (const char* header :
       {"channel 0: a [A]\nchannel 1: b [V]\n", "fs_hz: unknown\nchannel 0: a\nchannel 1: b\n",
        "fs_hz: 10\nchannel 0: t_s\nchannel 1: b [A]\n"}) {
    const auto other = TableFile::open(put(header, kNumbers));
    CHECK(other && other->layout().headings.size() == 2);
  }
}

void refused() {
  struct Case {
    std::string header;
    std::size_t more_bytes;
    const char* said;
  };
  std::string nine = kHeader, late = kHeader;
  nine.replace(nine.find("channels: 2"), 11, "channels: 9");
  late.replace(late.find("samples: 3"), 10, "samples: 4");
  for (const Case& c :
       std::vector<Case>{{"fs_hz: 500\n", 0, "names no channel"},
                         {"format: float64\nchannel 0: a\n", 0, "a.hdr:1: the format is 'float64'"},
                         {"format: float32 big-endian\nchannel 0: a\n", 0, "the format is"},
                         {"fs_hz: -1\nchannel 0: a\n", 0, "'fs_hz' is '-1'"},
                         {"samples: 0.5\nchannel 0: a\n", 0, "'samples' is '0.5'"},
                         {"channel 1: a\n", 0, "expected channel 0, found channel 1"},
                         {"channel 0: a\nchannel 1:\n", 0, "a.hdr:2: the channel has no name"},
                         {nine, 0, "says 9 channels and names 2"},
                         {late, 0, "holds 3 rows"},
                         {kHeader, 3, "no whole number of rows of 2 channels"}}) {
    const auto matrix = BinaryMatrix::open(put(c.header, kNumbers, c.more_bytes));
    CHECK(!matrix);
    if (matrix) continue;
    check::that(matrix.error().sentence.find(c.said) != std::string::npos,
                matrix.error().sentence.c_str(), __FILE__, __LINE__);
  }
  CHECK(!BinaryMatrix::open(put(kHeader, {})));
  std::filesystem::remove(folder / "a.hdr");
  const auto alone = BinaryMatrix::open((folder / "a.f32").string());
  CHECK(!alone && alone.error().kind == ErrorKind::device &&
        alone.error().sentence.find("a.hdr") != std::string::npos);
}

}  // namespace

int main() {
  std::filesystem::create_directories(folder);
  numbers();
  as_a_table();
  refused();
  std::filesystem::remove_all(folder);
  return check::done();
}
