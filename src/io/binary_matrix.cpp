#include "servosense/io/binary_matrix.hpp"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <optional>
#include <streambuf>
#include <utility>

#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::size_t kMostChannels = 4096;

/// What stands behind "KEY:", if the line is of that key.
std::optional<std::string_view> value_of(std::string_view line, std::string_view key) {
  if (!line.starts_with(key) || line.size() == key.size() || line[key.size()] != ':') return {};
  return trim(line.substr(key.size() + 1));
}

/// "3: power_sub [W] of the sub spindle" behind "channel ".
std::optional<std::pair<std::size_t, MatrixHeader::Channel>> channel_of(std::string_view line) {
  constexpr std::string_view kWord = "channel ";
  if (!line.starts_with(kWord)) return {};
  line.remove_prefix(kWord.size());
  std::size_t number = 0;
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), number);
  if (error != std::errc{} || end == line.data() + line.size() || *end != ':') return {};
  std::string_view rest = trim(line.substr(static_cast<std::size_t>(end - line.data()) + 1));
  MatrixHeader::Channel channel;
  const std::size_t blank = std::min(rest.find(' '), rest.size());
  channel.name = rest.substr(0, blank);
  rest = trim(rest.substr(blank));
  if (const std::size_t close = rest.find(']'); rest.starts_with('[') && close != rest.npos) {
    channel.unit = trim(rest.substr(1, close - 1));
    rest = trim(rest.substr(close + 1));
  }
  channel.remark = rest;
  return std::pair{number, std::move(channel)};
}

struct Stated {
  std::optional<double> rows, channels;
};

Expected<MatrixHeader> read_header(const std::string& path, Stated& stated) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path);
  MatrixHeader header;
  std::string_view line;
  for (;;) {
    const auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    line = trim(line);
    if (line.empty()) continue;
    const auto count = [&](std::string_view key, std::optional<double>& to) -> Expected<bool> {
      const auto text = value_of(line, key);
      if (!text) return false;
      const auto number = parse_number(*text);
      if (!number.ok() || number.value < 1 || number.value != std::floor(number.value))
        return lines.error_here("'" + std::string(key) + "' is '" + printable(*text, 40) +
                                "'; write a whole number from 1 on");
      to = number.value;
      return true;
    };
    const auto rows = count("samples", stated.rows);
    if (!rows) return rows.error();
    const auto channels = count("channels", stated.channels);
    if (!channels) return channels.error();
    if (*rows || *channels) continue;
    if (const auto format = value_of(line, "format")) {
      if (format->find("float32") == format->npos || format->find("big-endian") != format->npos)
        return lines.error_here("the format is '" + printable(*format, 80) +
                                "'; only 'float32 little-endian', row by row, is read");
    } else if (const auto rate = value_of(line, "fs_hz")) {
      const auto number = parse_number(*rate);
      if (*rate != "unknown" && !(number.ok() && number.value > 0))
        return lines.error_here("'fs_hz' is '" + printable(*rate, 40) +
                                "'; write a number above 0, or 'unknown'");
      header.rate_hz = number.ok() ? number.value : 0;
    } else if (auto channel = channel_of(line)) {
      if (channel->first != header.channels.size())
        return lines.error_here("expected channel " + std::to_string(header.channels.size()) +
                                ", found channel " + std::to_string(channel->first) +
                                "; number them from 0 on, one a line");
      if (channel->second.name.empty())
        return lines.error_here("the channel has no name; write 'channel " +
                                std::to_string(channel->first) + ": NAME [UNIT]'");
      if (header.channels.size() == kMostChannels)
        return lines.error_here("more than " + std::to_string(kMostChannels) +
                                " channels; give a file of fewer");
      header.channels.push_back(std::move(channel->second));
    } else {
      header.remarks.emplace_back(line);
    }
  }
  if (header.channels.empty())
    return data_error(path + ": names no channel; write a line 'channel 0: NAME [UNIT]' for each");
  if (stated.channels && *stated.channels != static_cast<double>(header.channels.size()))
    return data_error(path + ": says " + std::to_string(std::llround(*stated.channels)) +
                      " channels and names " + std::to_string(header.channels.size()) +
                      "; name every channel in a line 'channel 0: NAME [UNIT]'");
  return header;
}

/// Text that is made row by row.
class MatrixText : public std::streambuf {
 public:
  explicit MatrixText(BinaryMatrix matrix)
      : matrix_(std::move(matrix)), row_(matrix_.header().channels.size()) {
    const auto& channels = matrix_.header().channels;
    has_time_ = matrix_.header().rate_hz > 0 &&
                std::none_of(channels.begin(), channels.end(),
                             [](const auto& channel) { return channel.name == "t_s"; });
    give_heading();
  }

 protected:
  int_type underflow() override {
    const auto more = matrix_.next(row_);
    // Out of a streambuf only an exception tells a failure from the end; the stream keeps it as its
    // state.
    if (!more) throw std::ios_base::failure(more.error().sentence);
    if (!*more) return traits_type::eof();
    text_.clear();
    if (has_time_) put(static_cast<double>(rows_) / matrix_.header().rate_hz);
    for (std::size_t i = 0; i < row_.size(); ++i) {
      if (i > 0 || has_time_) text_ += ',';
      put(row_[i]);
    }
    text_ += '\n';
    ++rows_;
    return give();
  }
  pos_type seekoff(off_type offset, std::ios_base::seekdir from, std::ios_base::openmode) override {
    return from == std::ios_base::beg ? seekpos(offset, std::ios_base::in) : pos_type(off_type(-1));
  }
  pos_type seekpos(pos_type to, std::ios_base::openmode) override {
    if (to != pos_type(0) || !matrix_.rewind()) return {off_type(-1)};
    rows_ = 0;
    give_heading();
    return {0};
  }

 private:
  template <class Real>
  void put(Real value) {
    if (std::isnan(value)) {
      text_ += "nan";
      return;
    }
    char digits[32];
    text_.append(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
  }
  int_type give() {
    setg(text_.data(), text_.data(), text_.data() + text_.size());
    return traits_type::to_int_type(text_.front());
  }
  void give_heading() {
    text_.clear();
    const auto line = [&](std::string_view words) {
      text_ += "# ";
      text_ += words;
      text_ += '\n';
    };
    const MatrixHeader& header = matrix_.header();
    for (const auto& remark : header.remarks) line(remark);
    for (const auto& channel : header.channels)
      if (!channel.remark.empty()) line(channel.name + ": " + channel.remark);
    if (has_time_) text_ += "t_s,";
    for (const auto& channel : header.channels) {
      if (&channel != &header.channels.front()) text_ += ',';
      // A quotation mark, and every comma, of the heading itself.
      std::string heading = channel.name + (channel.unit.empty() ? "" : " [" + channel.unit + "]");
      for (std::size_t at = 0; (at = heading.find('"', at)) != heading.npos; at += 2)
        heading.insert(at, 1, '"');
      text_ += '"' + heading + '"';
    }
    text_ += '\n';
    give();
  }

  BinaryMatrix matrix_;
  std::vector<float> row_;
  std::string text_;
  std::uint64_t rows_ = 0;
  bool has_time_ = false;
};

/// A stream that owns what it reads from.
class MatrixStream : public std::istream {
 public:
  explicit MatrixStream(BinaryMatrix matrix) : std::istream(nullptr), text_(std::move(matrix)) {
    rdbuf(&text_);
  }

 private:
  MatrixText text_;
};

}  // namespace

BinaryMatrix::BinaryMatrix(MatrixHeader header, std::unique_ptr<std::istream> stream,
                           std::string name)
    : header_(std::move(header)),
      stream_(std::move(stream)),
      name_(std::move(name)),
      bytes_(4 * header_.channels.size()) {}

bool BinaryMatrix::is_matrix(const std::string& path) {
  const auto extension = std::filesystem::path(path).extension();
  return extension == ".f32" || extension == ".hdr";
}

Expected<BinaryMatrix> BinaryMatrix::open(const std::string& path) {
  const std::filesystem::path given(path);
  const std::string name = std::filesystem::path(given).replace_extension(".f32").string();
  const std::string header_name = std::filesystem::path(given).replace_extension(".hdr").string();
  Stated stated;
  auto header = read_header(header_name, stated);
  if (!header) return header.error();
  auto stream = open_for_reading(name);
  if (!stream) return stream.error();
  std::error_code none;
  const std::uint64_t size = std::filesystem::file_size(name, none);
  const std::uint64_t row = 4 * header->channels.size();
  if (none) return device_error(name + ": its size cannot be told: " + none.message());
  if (size == 0) return data_error(name + ": holds no rows; fetch it again");
  if (size % row != 0)
    return data_error(name + ": has " + std::to_string(size) +
                      " bytes, no whole number of rows of " +
                      std::to_string(header->channels.size()) + " channels; fetch it again");
  header->rows = size / row;
  if (stated.rows && *stated.rows != static_cast<double>(header->rows))
    return data_error(name + ": holds " + std::to_string(header->rows) + " rows, " + header_name +
                      " says " + std::to_string(std::llround(*stated.rows)) + "; fetch both again");
  return BinaryMatrix(std::move(*header), std::move(*stream), name);
}

Expected<bool> BinaryMatrix::next(std::span<float> row) {
  if (row_ == header_.rows) return false;
  if (!stream_->read(reinterpret_cast<char*>(bytes_.data()),
                     static_cast<std::streamsize>(bytes_.size())))
    return device_error(name_ + ": cannot be read beyond row " + std::to_string(row_) +
                        "; fetch it again");
  for (std::size_t i = 0; i < row.size(); ++i) {
    std::uint32_t bits = 0;
    for (std::size_t byte = 4; byte-- > 0;) bits = bits << 8U | bytes_[4 * i + byte];
    row[i] = std::bit_cast<float>(bits);
  }
  ++row_;
  return true;
}

Expected<Done> BinaryMatrix::rewind() {
  stream_->clear();
  row_ = 0;
  if (!stream_->seekg(0)) return device_error(name_ + ": cannot be read a second time");
  return Done{};
}

std::unique_ptr<std::istream> text_of(BinaryMatrix matrix) {
  return std::make_unique<MatrixStream>(std::move(matrix));
}

}  // namespace servosense
