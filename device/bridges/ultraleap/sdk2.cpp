// palpate-ultraleap for the vendor's SDK 2. CMakeLists.txt builds it; by hand, with the SDK's folder in $SDK:
//   c++ -std=c++14 -O2 -I"$SDK/include" sdk2.cpp -o palpate-ultraleap -L"$SDK/lib" -lUltrahaptics -pthread
// (on Windows with -lws2_32 behind it, or with MSVC: cl /std:c++14 /O2 /EHsc /I"%SDK%\include" sdk2.cpp
// /Fepalpate-ultraleap.exe /link /LIBPATH:"%SDK%\lib" Ultrahaptics.lib ws2_32.lib)
#include "program.hpp"

#include <UltrahapticsTimePointStreaming.hpp>
#include <chrono>
#include <cmath>

namespace palpate {
namespace {

namespace streaming = Ultrahaptics::TimePointStreaming;

void require(bool is_done, const std::string& request) {
  if (!is_done) throw Failure("the Ultrahaptics library cannot " + request);  // SDK 2 does not say why
}

class Sdk2Array : public FocusArray {
 public:
  Sdk2Array(std::unique_ptr<streaming::Emitter> emitter, Player& player) : emitter_(std::move(emitter)), player_(player) {
    require(emitter_->isConnected(), "find the array (is it plugged in and switched on? does another program use it?)");
    require(emitter_->setEmissionCallback(&Sdk2Array::play, this), "set the emission callback");
  }

  ~Sdk2Array() override { emitter_->stop(); }

  ArrayInfo info() override {
    auto info = emitter_->getDeviceInfo();
    return {UH_SDK_VERSION_LONG, info.getDeviceIdentifier(), info.getModelName(), info.getFirmwareVersion()};
  }

  double rate_limit(unsigned point_count) override {
    if (point_count > emitter_->getMaximumControlPointLimit()) return 0;
    emitter_->setMaximumControlPointCount(point_count);  // the limit is that of the count which is set
    return emitter_->getSampleRateLimit();
  }

  double set_up(unsigned point_count) override {
    unsigned most = static_cast<unsigned>(std::floor(rate_limit(point_count)));
    require(most > 0, "set " + std::to_string(point_count) + " control point(s)");
    unsigned rate = emitter_->setSampleRate(most);
    return rate > 0 ? rate : emitter_->getSampleRate();  // 0: the array has one rate alone
  }

  void start() override {
    is_begun_ = false;
    require(emitter_->start(), "start");
  }

  void stop() override { require(emitter_->stop(), "stop"); }

  long long missed_callbacks() override { return -1; }

 private:
  // A template, because the type of the deadline has another name in older versions of SDK 2.
  template <class Time>
  static void play(const streaming::Emitter&, streaming::OutputInterval& interval, const Time&, void* user) {
    static_cast<Sdk2Array*>(user)->fill(interval);
  }

  void fill(streaming::OutputInterval& interval) {
    if (!player_.begin_interval()) return;
    for (auto& sample : interval) {  // once: the library takes over what was set when the next sample is asked for
      std::chrono::steady_clock::time_point time = sample;
      if (!is_begun_) {
        origin_ = time;
        is_begun_ = true;
      }
      std::chrono::duration<double> since = time - origin_;
      const Point* points = player_.next(since.count());
      for (unsigned i = 0; i < player_.point_count(); ++i) {
        auto& control_point = sample.persistentControlPoint(i);
        if (points[i].intensity > 0)
          control_point.setPosition(Ultrahaptics::Vector3(points[i].x, points[i].y, points[i].z));
        control_point.setIntensity(points[i].intensity);
      }
    }
    player_.end_interval();
  }

  std::unique_ptr<streaming::Emitter> emitter_;
  Player& player_;
  std::chrono::steady_clock::time_point origin_;  // time of the first device sample since `start`
  bool is_begun_ = false;
};

}  // namespace

const char* sdk_name() { return "Ultrahaptics SDK " UH_SDK_VERSION_LONG; }

std::unique_ptr<FocusArray> open_array(const ArrayOptions& options, Player& player) {
  if (!options.connect.empty()) throw Misuse("--connect is for SDK 3: SDK 2 connects in one way alone");
  using Emitter = streaming::Emitter;
  std::unique_ptr<Emitter> emitter(options.device.empty() ? new Emitter() : new Emitter(options.device.c_str()));
  return std::unique_ptr<FocusArray>(new Sdk2Array(std::move(emitter), player));
}

std::vector<std::string> list_arrays(const ArrayOptions& options) {
  Player player;  // SDK 2 lists no arrays: the one that it takes by itself is all there is to say
  return {open_array(options, player)->info().identifier};
}

}  // namespace palpate

int main(int argc, char** argv) { return palpate::run(argc, argv); }
