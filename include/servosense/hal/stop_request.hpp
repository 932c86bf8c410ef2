// A feed hold for an alarm, sent once an event, without holding up whoever raised it.
//
// raise() is for the thread that runs the monitors: an atomic, and a write to an event descriptor
// when somebody waits for it; no lock, no memory. A thread of its own then tells the controller,
// again and again until it acknowledges, and looks whether the feed is held indeed. While it is,
// further alarms join it. When the operator has released the feed (servosense never does), the next
// alarm is a new event.
//
// Reaction: from the arrival of the sample that raised the alarm to the controller's
// acknowledgement. What comes behind that, braking, is the machine's. With a link whose tries take
// `t` until they fail, n losses in a row cost n (t + retry_s), and a new connection each.
// A monitoring aid, not a safety function: the emergency stop has to work without it.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <thread>

#include "servosense/hal/cnc_link.hpp"
#include "servosense/hal/real_time_thread.hpp"

namespace servosense {

struct StopRequestConfig {
  double retry_s = 0.002;  ///< pause between tries
  double watch_s = 0.05;   ///< between looks whether the feed is still held
  double give_up_s = 10;   ///< an alarm so old is no reason to stop any more
  double finish_s = 1;     ///< stop() waits so long for a feed hold that is on its way
};

struct StopHealth {
  std::uint64_t raised = 0;  ///< calls of raise()
  std::uint64_t events = 0;  ///< alarms that asked for a feed hold
  std::uint64_t held = 0;    ///< of them, acknowledged
  std::uint64_t tries = 0;   ///< feed holds sent
  std::uint64_t joined = 0;  ///< looked at while another held or was on its way
  std::uint64_t released = 0;
  std::uint64_t given_up = 0;
  bool holding = false;  ///< the feed is held, for all we know
  LatencyHistogram reaction;
};

class StopRequest {
 public:
  /// The link must outlive the request, and belong to it alone.
  explicit StopRequest(CncLink& link, StopRequestConfig config = {});
  StopRequest(const StopRequest&) = delete;
  StopRequest& operator=(const StopRequest&) = delete;
  ~StopRequest();

  /// Hold the feed, for a sample that arrived at `arrival_ns` by the link's clock. Never waits.
  void raise(Nanoseconds arrival_ns) noexcept;
  /// An alarm is on its way, or the feed is held.
  [[nodiscard]] bool active() const noexcept { return active_.load(std::memory_order_relaxed); }

  /// Starts the thread; connects.
  void start();
  /// Ends it; what is held stays held.
  void stop();
  /// What the thread does over and over: one try or one look. Returns how long to wait then [s];
  /// negative: until something is raised. For tests, and for hosts that have a thread already.
  double turn();
  [[nodiscard]] StopHealth health() const;

 private:
  enum class Phase { armed, asking, held };
  void run();
  void begin(Nanoseconds arrival_ns);
  double ask();
  double watch();

  CncLink& link_;
  StopRequestConfig config_;
  int wake_ = -1;
  std::atomic<Nanoseconds> arrival_;
  std::atomic<std::uint64_t> raised_{0};
  std::atomic<bool> active_{false};
  std::atomic<bool> stopping_{false};
  std::thread thread_;

  Phase phase_ = Phase::armed;  // the thread's own, down to here
  bool connected_ = false;
  bool acknowledged_ = false;
  Nanoseconds began_ns_ = 0;

  mutable std::mutex mutex_;  // of health_
  StopHealth health_;
};

}  // namespace servosense
