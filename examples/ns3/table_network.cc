/*
 * An acoustic network in ns-3 whose delays and shadows come from a MantaRay travel-time table.
 *
 * SPDX-License-Identifier: MIT
 *
 * A beacon and three vehicles transmit in turn. The same network is run with ns-3's own model (a constant 1500 m/s) and with a table
 * (model MantarayPropModel below), and every reception of both runs is printed:
 *
 *     mantaray table profile.csv --source-depth 10:900 --receiver-depth 10:900 --range 50:6000 --error 3 \
 *         --out table.mtt --c-reader mantaray_table.h
 *     g++ -std=c++17 table_network.cc -o table_network $(pkg-config --cflags --libs ns3-uan ns3-mobility ns3-network ns3-core)
 *     ./table_network table.mtt
 *
 * Debian packages: libns3-dev (3.37) and libgsl-dev. Depth is minus z, as in ns-3's AuvMobilityModel.
 */
#include "mantaray_table.h"

#include "ns3/core-module.h"
#include "ns3/mobility-module.h"
#include "ns3/network-module.h"
#include "ns3/uan-module.h"

#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <vector>

using namespace ns3;

/** Delays from a travel-time table. Losses are those of Thorp's model over the same distance; a shadow lets nothing through. */
class MantarayPropModel : public UanPropModel
{
  public:
    static TypeId GetTypeId()
    {
        static TypeId tid = TypeId("MantarayPropModel").SetParent<UanPropModel>().AddConstructor<MantarayPropModel>();
        return tid;
    }

    /** Use a table; it must exist as long as this model. */
    void SetTable(const mantaray_table* table) { m_table = table; }

    double GetPathLossDb(Ptr<MobilityModel> a, Ptr<MobilityModel> b, UanTxMode mode) override
    {
        return mantaray_has_range(LookUp(a, b).status) ? m_thorp->GetPathLossDb(a, b, mode) : 1e3;
    }

    UanPdp GetPdp(Ptr<MobilityModel>, Ptr<MobilityModel>, UanTxMode) override { return UanPdp::CreateImpulsePdp(); }

    Time GetDelay(Ptr<MobilityModel> a, Ptr<MobilityModel> b, UanTxMode mode) override
    {
        mantaray_result r = LookUp(a, b);
        return mantaray_has_range(r.status) ? Seconds(r.travel_time) : m_thorp->GetDelay(a, b, mode);
    }

  private:
    /** Travel time between two nodes; a table holds in both directions, so the shallower end is its source if needed. */
    mantaray_result LookUp(Ptr<MobilityModel> a, Ptr<MobilityModel> b) const
    {
        Vector p = a->GetPosition(), q = b->GetPosition();
        double range = std::hypot(q.x - p.x, q.y - p.y);
        mantaray_result r;
        mantaray_travel_time(m_table, -p.z, -q.z, range, 0.0, &r);
        return r;
    }

    const mantaray_table* m_table = nullptr;
    Ptr<UanPropModelThorp> m_thorp = CreateObject<UanPropModelThorp>();
};

/** Arrival time of each packet that was received, by transmitter and receiver. */
using Receptions = std::map<std::pair<uint32_t, uint32_t>, double>;

static const std::vector<Vector> POSITIONS = {{0, 0, -150}, {2000, 500, -120}, {-1500, 2500, -700}, {3500, -1500, -30}};
static const double SLOT = 20.0; // s

/** Run the network with a propagation model. */
static Receptions
Run(Ptr<UanPropModel> model)
{
    NodeContainer nodes;
    nodes.Create(POSITIONS.size());
    auto places = CreateObject<ListPositionAllocator>();
    for (const Vector& position : POSITIONS)
    {
        places->Add(position);
    }
    MobilityHelper mobility;
    mobility.SetPositionAllocator(places);
    mobility.Install(nodes);

    auto channel = CreateObject<UanChannel>();
    channel->SetPropagationModel(model);
    channel->SetNoiseModel(CreateObject<UanNoiseModelDefault>());
    UanHelper uan;
    uan.SetMac("ns3::UanMacAloha");
    uan.SetPhy("ns3::UanPhyGen", "TxPower", DoubleValue(185.0));
    NetDeviceContainer devices = uan.Install(nodes, channel);

    Receptions received;
    for (uint32_t i = 0; i < devices.GetN(); i++)
    {
        devices.Get(i)->SetReceiveCallback(
            [&received, i](Ptr<NetDevice>, Ptr<const Packet> packet, uint16_t, const Address&) {
                uint8_t from = 0;
                packet->CopyData(&from, 1);
                received[{from, i}] = Simulator::Now().GetSeconds() - SLOT * from;
                return true;
            });
        Simulator::Schedule(Seconds(SLOT * i), [&devices, i] {
            uint8_t content[8] = {static_cast<uint8_t>(i)};
            Ptr<NetDevice> device = devices.Get(i);
            device->Send(Create<Packet>(content, sizeof content), device->GetBroadcast(), 0);
        });
    }
    Simulator::Stop(Seconds(SLOT * (POSITIONS.size() + 1)));
    Simulator::Run();
    Simulator::Destroy();
    return received;
}

int
main(int argc, char** argv)
{
    std::ifstream file(argc > 1 ? argv[1] : "table.mtt", std::ios::binary);
    std::vector<char> bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    mantaray_table table;
    if (int error = mantaray_table_open(&table, bytes.data(), bytes.size()))
    {
        std::fprintf(stderr, "%s: not a travel-time table (error %d)\n", argc > 1 ? argv[1] : "table.mtt", error);
        return 1;
    }
    auto model = CreateObject<MantarayPropModel>();
    model->SetTable(&table);
    Receptions constant = Run(CreateObject<UanPropModelThorp>());
    Receptions refracted = Run(model);
    std::printf("from,to,straight_m,constant_s,table_s,difference_ms\n");
    for (uint32_t i = 0; i < POSITIONS.size(); i++)
    {
        for (uint32_t j = 0; j < POSITIONS.size(); j++)
        {
            if (i == j || !constant.count({i, j}))
            {
                continue;
            }
            double straight = CalculateDistance(POSITIONS[i], POSITIONS[j]), time = constant[{i, j}];
            std::printf("%u,%u,%.1f,%.6f,", i, j, straight, time);
            if (refracted.count({i, j}))
            {
                std::printf("%.6f,%.3f\n", refracted[{i, j}], 1e3 * (refracted[{i, j}] - time));
            }
            else
            {
                std::printf("lost,\n");
            }
        }
    }
    return 0;
}
