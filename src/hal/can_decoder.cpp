#include "servosense/hal/can_decoder.hpp"

#include <algorithm>
#include <utility>

namespace servosense {
namespace {

// Classes of error frames, linux/can/error.h.
struct ErrorClass {
  std::uint32_t bit;
  const char* text;
};
constexpr std::uint32_t kControllerProblem = 0x4;
constexpr std::uint32_t kBusOff = 0x40;
constexpr std::array<ErrorClass, 9> kErrorClasses = {{{0x1, "transmit timeout"},
                                                      {0x2, "lost arbitration"},
                                                      {kControllerProblem, "controller problem"},
                                                      {0x8, "protocol violation"},
                                                      {0x10, "transceiver problem"},
                                                      {0x20, "no acknowledgement"},
                                                      {kBusOff, "bus off"},
                                                      {0x80, "bus error"},
                                                      {0x100, "controller restarted"}}};
constexpr std::uint8_t kOverflow = 0x3;  // receive or transmit, data[1] of a controller problem

AlignerConfig aligner_config(const CanMap& map, unsigned wait_rows) {
  AlignerConfig config;
  config.period_ns = map.period_ns;
  config.sync = map.sync_key.has_value();
  config.wait_rows = wait_rows;
  std::size_t column = 0;
  for (const MapMessage& m : map.messages) {
    if (m.fields.empty()) continue;  // a status word alone
    config.streams.push_back(
        {column, m.fields.size(), m.samples, m.every, m.sequence ? m.sequence->bits : 0U});
    column += m.fields.size();
  }
  return config;
}

std::string count_of(std::uint64_t n, const char* one, const char* many) {
  return std::to_string(n) + ' ' + (n == 1 ? one : many);
}

}  // namespace

CanDecoder::CanDecoder(CanMap map, unsigned wait_rows)
    : map_(std::move(map)),
      aligner_(aligner_config(map_, wait_rows)),
      status_(map_.messages.size()),
      faulted_(map_.messages.size()) {
  std::size_t largest = 0, streams = 0;
  for (const MapMessage& m : map_.messages) {
    streams_.push_back(streams);
    if (!m.fields.empty()) ++streams;
    largest = std::max(largest, std::size_t{m.samples} * m.fields.size());
  }
  fields_.resize(largest);
}

void CanDecoder::note_error(const CanFrame& frame) noexcept {
  ++health_.errors;
  if ((frame.id & kBusOff) != 0) ++health_.bus_off;
  if ((frame.id & kControllerProblem) != 0 && (frame.data[1] & kOverflow) != 0) ++health_.overflows;
}

void CanDecoder::push(const CanFrame& frame) noexcept {
  if (frame.error) return note_error(frame);
  if (frame.remote) {
    ++health_.remote;
    return;
  }
  if (map_.sync_key && frame.key() == *map_.sync_key) return aligner_.sync(frame.t_ns);
  bool known = false, complete = true;
  for (std::size_t i = 0; i < map_.messages.size(); ++i) {
    const MapMessage& message = map_.messages[i];
    if (message.key != frame.key()) continue;
    known = true;
    if (const auto& m = message.multiplexing) {
      const auto value = raw_bits(frame.bytes(), m->field);
      if (!value) complete = false;
      if (value != m->value) continue;
    }
    if (!take(i, frame)) complete = false;
  }
  if (known) {
    ++health_.frames;
    if (!complete) ++health_.too_short;
    return;
  }
  const bool alive = std::find(map_.heartbeat_keys.begin(), map_.heartbeat_keys.end(),
                               frame.key()) != map_.heartbeat_keys.end();
  ++(alive ? health_.heartbeats : health_.unknown);
}

bool CanDecoder::take(std::size_t index, const CanFrame& frame) noexcept {
  const MapMessage& message = map_.messages[index];
  bool complete = true;
  std::size_t n = 0;
  for (unsigned sample = 0; sample < message.samples; ++sample)
    for (const MapField& field : message.fields) {
      fields_[n] = read_field(frame, field, sample, is_counts(map_.signals[field.column]));
      complete = complete && fields_[n].state == TraceField::State::value;
      ++n;
    }
  if (message.status_word)
    if (const auto word = raw_bits(frame.bytes(), *message.status_word)) {
      status_[index] = static_cast<std::uint16_t>(*word);
      if ((*word & 0x4FU) == 0x08 || (*word & 0x4FU) == 0x0F) faulted_[index] = true;
    }
  if (message.fields.empty()) return complete;
  std::optional<std::uint32_t> sequence;
  if (message.sequence)
    if (const auto raw = raw_bits(frame.bytes(), *message.sequence))
      sequence = static_cast<std::uint32_t>(*raw);
  aligner_.push(streams_[index], frame.t_ns, {fields_.data(), n}, sequence);
  return complete;
}

std::vector<std::string> CanDecoder::remarks() const {
  std::vector<std::string> all;
  const AlignerHealth& a = aligner_.health();
  if (health_.frames == 0)
    all.emplace_back("no frame that the map speaks of was received; check its identifiers");
  if (a.lost > 0) all.push_back(count_of(a.lost, "frame was", "frames were") + " lost");
  if (a.duplicates > 0)
    all.push_back(count_of(a.duplicates, "frame came", "frames came") + " twice; dropped");
  if (a.late > 0)
    all.push_back(count_of(a.late, "frame came", "frames came") + " too late; dropped");
  if (a.reordered > 0)
    all.push_back(count_of(a.reordered, "frame", "frames") + " came out of order; put in place");
  if (a.restarts > 0)
    all.push_back(count_of(a.restarts, "stretch of silence or restart",
                           "stretches of silence or "
                           "restarts") +
                  " of a sender");
  if (health_.too_short > 0)
    all.push_back(count_of(health_.too_short, "frame was", "frames were") +
                  " shorter than the map says, or held no number; the signals are marked invalid");
  if (health_.errors > 0)
    all.push_back(count_of(health_.errors, "error frame", "error frames") + ", " +
                  std::to_string(health_.bus_off) + " of them bus off, " +
                  std::to_string(health_.overflows) + " overflow");
  for (std::size_t i = 0; i < faulted_.size(); ++i)
    if (faulted_[i] && !map_.messages[i].fields.empty())
      all.push_back(
          "the drive of " + column_name(map_.signals[map_.messages[i].fields.front().column]) +
          " reported a fault; its last state is '" + std::string(cia402_state(status_[i])) + "'");
  return all;
}

std::string can_error_text(const CanFrame& frame) {
  std::string text;
  for (const ErrorClass& c : kErrorClasses)
    if ((frame.id & c.bit) != 0) text += (text.empty() ? "" : ", ") + std::string(c.text);
  return text.empty() ? "unknown error" : text;
}

}  // namespace servosense
