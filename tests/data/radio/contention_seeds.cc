// Made contention_seeds.csv: 27-byte broadcasts every 1.5 s for 15 s on a grid of 4 m, phases drawn once within --jit
// seconds. Built against ns-3 3.44 (PyPI ns3 3.44.post0):  g++ -std=c++20 -Iinclude contention_seeds.cc -Llib64 -lns3.44-…
#include "ns3/core-module.h"
#include "ns3/internet-module.h"
#include "ns3/mobility-module.h"
#include "ns3/network-module.h"
#include "ns3/wifi-module.h"

#include <cmath>
#include <cstdio>
#include <vector>

using namespace ns3;

static const double PERIOD_S = 1.5;
static uint64_t received, sent;
static std::vector<Ptr<Socket>> sockets;

static void Receive(Ptr<Socket> socket)
{
    while (socket->Recv())
        received++;
}

static void Send(uint32_t i, double end_s)
{
    if (Simulator::Now().GetSeconds() > end_s)
        return;
    sockets[i]->SendTo(Create<Packet>(27), 0, InetSocketAddress(Ipv4Address("10.255.255.255"), 9));
    sent++;
    Simulator::Schedule(Seconds(PERIOD_S), &Send, i, end_s);
}

int main(int argc, char** argv)
{
    uint32_t N = 25, seed = 1;
    double spacing_m = 4, jitter_s = 0.001, seconds = 15;
    CommandLine cmd;
    cmd.AddValue("N", "robots", N);
    cmd.AddValue("sp", "spacing, m", spacing_m);
    cmd.AddValue("jit", "phases lie within, s", jitter_s);
    cmd.AddValue("t", "simulated, s", seconds);
    cmd.AddValue("seed", "run", seed);
    cmd.Parse(argc, argv);
    RngSeedManager::SetSeed(1);
    RngSeedManager::SetRun(seed);

    NodeContainer nodes;
    nodes.Create(N);
    YansWifiChannelHelper channel;
    channel.SetPropagationDelay("ns3::ConstantSpeedPropagationDelayModel");
    channel.AddPropagationLoss("ns3::LogDistancePropagationLossModel", "ReferenceLoss", DoubleValue(36.05),
                               "Exponent", DoubleValue(3.0), "ReferenceDistance", DoubleValue(1));
    YansWifiPhyHelper phy;
    phy.SetChannel(channel.Create());
    phy.Set("ChannelSettings", StringValue("{0, 20, BAND_6GHZ, 0}"));
    WifiMacHelper mac;
    mac.SetType("ns3::AdhocWifiMac");
    WifiHelper wifi;
    wifi.SetStandard(WIFI_STANDARD_80211ax);
    wifi.SetRemoteStationManager("ns3::ConstantRateWifiManager", "DataMode", StringValue("HeMcs3"), "ControlMode",
                                 StringValue("OfdmRate24Mbps"));
    NetDeviceContainer devices = wifi.Install(phy, mac, nodes);

    MobilityHelper mobility;
    Ptr<ListPositionAllocator> places = CreateObject<ListPositionAllocator>();
    uint32_t side = std::round(std::sqrt(N));
    for (uint32_t i = 0; i < N; i++)
        places->Add(Vector((i % side) * spacing_m, (i / side) * spacing_m, 0));
    mobility.SetPositionAllocator(places);
    mobility.Install(nodes);
    InternetStackHelper internet;
    internet.Install(nodes);
    Ipv4AddressHelper addresses;
    addresses.SetBase("10.0.0.0", "255.0.0.0");
    addresses.Assign(devices);

    Ptr<UniformRandomVariable> phase = CreateObject<UniformRandomVariable>();
    for (uint32_t i = 0; i < N; i++)
    {
        Ptr<Socket> socket = Socket::CreateSocket(nodes.Get(i), UdpSocketFactory::GetTypeId());
        socket->SetAllowBroadcast(true);
        socket->Bind(InetSocketAddress(Ipv4Address::GetAny(), 9));
        socket->SetRecvCallback(MakeCallback(&Receive));
        sockets.push_back(socket);
        Simulator::ScheduleWithContext(i, Seconds(1.0 + phase->GetValue(0, jitter_s)), &Send, i, seconds + 0.99);
    }
    Simulator::Stop(Seconds(seconds + 1.5));
    Simulator::Run();
    std::printf("%u,%g,%u,%.4f\n", N, jitter_s, seed, received / (sent * (N - 1.0)));
}
